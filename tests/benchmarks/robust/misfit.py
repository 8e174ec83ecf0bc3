"""The parts `misfit`, `over_refusal` and `demo`: what certificates claim of drawn bearings, against their truth.

Half of the bearings are honest: the order is right, and the excitation reaches over the whole band. The others do not
fit in a way of their own (`misfit_plants.KINDS`). Each is certified under the mild controller with which its data are
taken, and predicted under an aggressive one. A claim is a lie if

- it covers the whole loop, certified or predicted, and the true loop is unstable or a true peak above its bound;
- it is restricted to a band, and the true sensitivity of an axis there is above its bound;
- an assumption that the data contradict is taken without a word;
- it is certified with data of another controller, or without reservation by a record that judges its own model.

A verdict that is restricted to a band states nothing on stability: these loops that are unstable are counted apart.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from amb_core.excitation import excitation_from_request, generate
from amb_core.ground.errors import AmbError
from amb_core.identification import IdentificationData, identify
from amb_core.identification.validation import validate
from amb_core.linear.peak import peak_gain
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.simulation import simulate
from amb_core.robustness import Certificate, Recorded, RobustnessSettings, certify_from_data
from amb_core.robustness.feedback import Feedback, law_from_positions
from tests.benchmarks.robust.misfit_plants import HONEST, KINDS, RATE, MisfitPlant, draw
from tests.benchmarks.robust.misfit_simulated import SIMULATED, SimulatedPlant, draw_simulated
from tests.benchmarks.robust.records import Size, records

CONTRADICTED = 0.02  # damping ratio that is assumed of a bearing with less
PLANTS = 400
SUMS = ("certified", "predicted", "restricted", "restricted_unstable", "lies")
_DENSE = np.geomspace(1.0, 4_990.0, 60_000)  # Hz, a sixth of the width of the narrowest mode apart


def misfit(size: Size) -> dict[str, Any]:
    """Claims and lies, the share of honest bearings that are certified, and how far their bounds are from the truth."""
    plants = PLANTS * size.runs // 200
    done = records("misfit", size, plants, lambda seed: _timed(seed, size))
    kinds = {kind: _of_kind([item for item in done if item["kind"] == kind]) for kind in (HONEST, *KINDS)}
    honest = kinds[HONEST]
    return {
        "plants": plants,
        **{name: sum(one[name] for one in kinds.values()) for name in SUMS},
        "honest": honest["plants"],
        "honest_certified": honest["mild_certified"],
        "width_median": honest["width_median"],
        "kinds": kinds,
    }


def _of_kind(done: list[dict[str, Any]]) -> dict[str, Any]:
    """The same of the plants of a kind; plants whose rotor falls or whose data give no model have no claim."""
    stated = [item[name] for item in done for name in ("mild", "aggressive") if item[name] is not None]
    certified = [item["mild"] for item in done if item["mild"] and item["mild"]["statement"].startswith("certified")]
    widths = [ratio for one in certified for ratio in one["widths"]]
    return {
        "plants": len(done),
        "certified": sum(one["statement"].startswith("certified") for one in stated),
        **{
            name: sum(one["statement"] == word for one in stated)
            for name, word in (("predicted",) * 2, ("restricted",) * 2, ("refused", "not certified"))
        },
        "without_claim": sum(item["mild"] is None for item in done),
        "lies": sum(one["lie"] for one in stated),
        "restricted_unstable": sum(one["statement"] == "restricted" and not one["stable"] for one in stated),
        "mild_certified": len(certified),
        "width_median": float(np.median(widths)) if widths else None,
        "seconds": float(np.median([item["seconds"] for item in done])) if done else None,
    }


def over_refusal(size: Size) -> dict[str, int]:
    """Right models of honest bearings with two axes, excited to 2 kHz only: those refused, or restricted to a band."""

    def one(seed: int) -> dict[str, Any]:
        plant = draw(HONEST, 10_000 + seed, 2)
        return _measured(replace(plant, highest=2_000.0), seed, size)

    done = records("over_refusal", size, size.runs, one)
    stated = [item["mild"]["statement"] if item["mild"] else "no model" for item in done]
    return {
        "models": len(done),
        "refused": sum(one in ("not certified", "no model") for one in stated),
        "restricted": stated.count("restricted"),
    }


def demo(size: Size) -> dict[str, Any]:
    """The certificate of the demo's square waves, and that of the guide's experiment, on the nonlinear simulator."""
    settings = RobustnessSettings(mode_gain=0.02)  # of a rotor that is a point mass, as the guide has it
    band = {"frequency_start": 2.0, "frequency_end": 2_000.0, "amplitude": 1e-6}
    squares = _simulated("square", {"amplitude": 40e-6, "duration": size.identification / 3.0})
    used = _simulated("multisine", {**band, "duration": size.identification})
    other = _simulated("multisine", {**band, "duration": size.identification / 3.0, "seed": 2})
    results = {}
    for name, data in (("squares", (squares, squares)), ("guide", (used, other))):
        model = identify(data[0].data, 10, controller=data[0].controller)
        certificate = certify_from_data(
            model.model, ControllerParameters(), *data, settings=settings, uncertainty=model.uncertainty
        )
        results[name] = {"statement": certificate.statement, "verdict": certificate.verdict}
    return results


def _simulated(kind: str, request: dict[str, Any]) -> Recorded:
    plant, controller, settled = PlantParameters(), ControllerParameters(), 2_000
    excitation = generate(excitation_from_request(kind, request), RATE).samples
    record = simulate(Plant(plant), PdController(controller), len(excitation) + settled, excitation, settled)
    data = IdentificationData.from_record(record.window(settled, len(excitation)))
    return Recorded(data, controller, plant)


def _kind(seed: int) -> str:
    return HONEST if seed % 2 == 0 else KINDS[seed // 2 % len(KINDS)]


def _drawn(seed: int) -> MisfitPlant | SimulatedPlant:
    kind = _kind(seed)
    return draw_simulated(kind, seed) if kind in SIMULATED else draw(kind, seed)


def _timed(seed: int, size: Size) -> dict[str, Any]:
    start = time.process_time()
    outcome = _measured(_drawn(seed), seed, size)
    return outcome | {"seconds": time.process_time() - start}


def _measured(plant: MisfitPlant | SimulatedPlant, seed: int, size: Size) -> dict[str, Any]:
    kind, mild, steps = plant.kind, plant.mild, 8 * size.steps
    records_of = [plant.record(steps, 2 * seed), plant.record(steps // 2, 2 * seed + 1, now=True)]
    if kind == "same record":
        records_of[1] = records_of[0]
    if any(record is None for record in records_of):
        return {"kind": kind, "axes": plant.axes, "mild": None, "aggressive": None, "failed": "the rotor falls"}
    used, judged = (
        Recorded(IdentificationData.from_record(record), plant.aggressive if kind == "wrong controller" else mild)
        for record in records_of
    )
    record: dict[str, Any] = {"kind": kind, "axes": plant.axes, "mild": None, "aggressive": None}
    try:
        identification = identify(used.data, plant.order, controller=mild)
    except AmbError as problem:
        return record | {"failed": str(problem)}
    settings = RobustnessSettings(mode_damping=CONTRADICTED) if kind == "wrong assumption" else RobustnessSettings()
    validation = validate(identification.model, judged.data, judged.controller, uncertainty=identification.uncertainty)
    for name, law in (("mild", mild), ("aggressive", plant.aggressive)):
        certificate = certify_from_data(
            identification.model,
            law,
            used,
            judged,
            settings=settings,
            validation=validation,
            uncertainty=identification.uncertainty,
        )
        record[name] = _judged(plant, law, certificate)
    return record


def _judged(plant: MisfitPlant | SimulatedPlant, law: ControllerParameters, certificate: Certificate) -> dict[str, Any]:
    """What a certificate states, and whether it is true."""
    true = Feedback(plant.true, law_from_positions(law, plant.axes))
    statement, assessment = certificate.statement, certificate.assessment
    outcome = {
        "statement": statement,
        "verdict": certificate.verdict,
        "stable": true.stable,
        "lie": False,
        "widths": [],
    }
    if statement == "not certified" or assessment is None or assessment.bounds is None or certificate.known is None:
        return outcome
    bounds = [axis.sensitivity.value for axis in assessment.bounds.axes]
    places = [plant.axes + axis for axis in range(plant.axes)]
    if statement == "restricted":
        inside = _DENSE[certificate.known.holds(_DENSE)]
        sizes = np.abs(np.diagonal(true.closed.response(inside)[:, places][:, :, places], axis1=1, axis2=2))
        outcome["lie"] = bool(np.any(sizes.max(axis=0) > bounds))
    else:
        peaks = [peak_gain(true.closed.part([place], [place])).value for place in places]
        seen = plant.measured_peaks(law)
        peaks = peaks if seen is None else np.maximum(peaks, seen).tolist()
        outcome["lie"] = not true.stable or bool(np.any(np.array(peaks) > bounds))
        outcome["widths"] = (np.array(bounds) / peaks).tolist()
    ran_another = plant.kind == "wrong controller" and law is plant.aggressive and statement.startswith("certified")
    judged_by_itself = plant.kind == "same record" and statement == "certified"
    if plant.kind == "wrong assumption" or ran_another or judged_by_itself:
        outcome["lie"] = True
    return outcome

"""Fig. 2: the bearing with 1 DOF under a sweep compared with an identified linear model, and its regions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from amb_bringup.paper.study import Claim, DrawnFigure, Study, StudyResult
from amb_bringup.paper.sweeps import (
    ONE_AXIS,
    SLOW_AMPLIFIER,
    SLOW_NOTE,
    SWEEP,
    SweptBearing,
    order_verdict,
    sweep_bearing,
)
from amb_core.excitation import Multisine, generate
from amb_core.figures.sweep import sweep_chart
from amb_core.figures.sweep_comparison import sweep_comparison_chart
from amb_core.identification import Identification, identify, nrmse_fit, simulate_closed_loop
from amb_core.loop.control import ControllerParameters, PdController
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant
from amb_core.regions import Region
from amb_core.report import Answer
from amb_core.simulation import simulate

AMPLITUDE = 15e-6  # m; the paper does not state its value
VOLTAGES = (300.0, 150.0, 75.0, 50.0, 30.0)  # V, of the supply: from that of table 1 to that of the slow amplifier
ORDER = 6  # of two bearings: rotor (2) and current loop (1) of each
EXCITATIONS = tuple(  # of the two copies; so small that the bearing stays in region A
    Multisine(amplitude=1e-6, frequency_start=11.0, frequency_end=1_000.0, duration=2.0, axes="y", seed=seed)
    for seed in (1, 2)
)
NO_LIMIT = 100.0  # A, of the controller in the loop of the model: never reached in the sweep, so the loop is linear
NEAR = 0.25  # by how much frequencies that are "approximately the same" may differ


@dataclass(frozen=True)
class Pole:
    """The dominant pole pair of a loop.

    Attributes
    ----------
    natural, damped : float
        Magnitude and imaginary part over 2 pi (Hz).
    """

    natural: float
    damped: float


class OneAxisSweep(Study):
    """The sweep with the parameters of table 1 and with a slower amplifier, each compared with its identified model."""

    name = "fig2"
    heading = "Fig. 2: the bearing with one axis under a sweep, and a linear model"

    def run(self) -> StudyResult:
        """Simulate, classify, identify, draw, evaluate."""
        scan = {
            voltage: sweep_bearing(AMPLITUDE, {**ONE_AXIS, "amplifier.supply_voltage": voltage}) for voltage in VOLTAGES
        }
        paper, slow = scan[VOLTAGES[0]], scan[SLOW_AMPLIFIER["amplifier.supply_voltage"]]
        names = {
            "fig2": f"supply of table 1, {VOLTAGES[0]:g} V",
            "fig2-slow-amplifier": f"slow amplifier, {SLOW_AMPLIFIER['amplifier.supply_voltage']:g} V",
        }
        figures, fits, poles = [], {}, {}
        for figure, bearing in zip(names, (paper, slow), strict=True):
            found = identify_bearing(bearing)
            model = model_response(found, bearing)
            fits[figure] = region_a_fit(bearing, model)
            poles[figure] = dominant_pole(found, bearing.controller.sample_rate)
            title = f"One axis, sweep of {1e6 * AMPLITUDE:g} µm: {names[figure]}"
            chart = sweep_chart(bearing.record, bearing.found, bearing.frequency, model=model, axes=("y",), title=title)
            figures.append(DrawnFigure.of(figure, chart))
        comparison = sweep_comparison_chart(
            [bearing.case(f"supply voltage {voltage:g} V") for voltage, bearing in scan.items()],
            title="The same sweep with increasingly slow amplifiers",
        )
        figures.insert(2, DrawnFigure.of("fig2-supply-voltage", comparison))
        return StudyResult(
            figures,
            [
                linear_claim({names[figure]: fit for figure, fit in fits.items()}),
                order_claim(paper, slow),
                frequency_claim(slow, poles["fig2-slow-amplifier"]),
                delevitation_claim({names["fig2"]: paper, names["fig2-slow-amplifier"]: slow}),
            ],
            {
                "amplitude": f"{1e6 * AMPLITUDE:g} µm (ours)",
                **SWEEP,
                "bearing": "electromagnets above and below the rotor, derivative on error, control current limit "
                f"{ControllerParameters().current_limit:g} A",
                "identification": f"PEM, order {ORDER}, on two bearings under different random-phase multisines of "
                f"{1e6 * EXCITATIONS[0].amplitude:g} µm, {EXCITATIONS[0].frequency_start:g} Hz to "
                f"{EXCITATIONS[0].frequency_end:g} Hz",
            },
            [
                SLOW_NOTE,
                "The library identifies plants with two inputs and two outputs. Two copies of the bearing, each with "
                "its own random signal, make such a plant. The model of the second copy is simulated under the sweep, "
                "in a loop without limits, since a linear loop has none.",
            ],
        )


def identify_bearing(bearing: SweptBearing) -> Identification:
    """A model of two copies of a bearing with 1 DOF, from data in region A."""
    copies = []
    for excitation in EXCITATIONS:
        signal = generate(excitation, bearing.controller.sample_rate)
        rest = int(np.argmax(np.isfinite(bearing.frequency)))
        record = simulate(
            Plant(bearing.plant.parameters), PdController(bearing.controller), rest + signal.steps, signal.samples, rest
        )
        copies.append(record.window(rest, signal.steps))
    reference, position, current = (
        np.column_stack([getattr(copy, name)[:, 1] for copy in copies]) for name in ("reference", "position", "current")
    )
    both = LoopRecord(copies[0].first_step, copies[0].sample_time, reference, position, current)
    return identify(both, ORDER, "pem", bearing.controller)


def model_response(found: Identification, bearing: SweptBearing) -> LoopRecord:
    """The model in the loop without limits under the reference of the sweep, which acts on the second copy, y."""
    unlimited = bearing.controller.model_copy(update={"current_limit": NO_LIMIT})
    rest = int(np.argmax(np.isfinite(bearing.frequency)))
    return simulate_closed_loop(found.model, unlimited, bearing.record.reference[rest:], rest)


def region_a_fit(bearing: SweptBearing, model: LoopRecord) -> tuple[float, float]:
    """Fit of the model (percent) to the response about its mean, in region A and beyond it."""
    first = model.first_step
    end = min((onset.step for onset in bearing.onsets.values()), default=bearing.record.steps)
    parts = []
    for span in (slice(first, end), slice(end, None)):
        measured = bearing.record.position[span, 1:]
        modelled = model.position[span.start - first : None if span.stop is None else span.stop - first, 1:]
        moving = len(measured) > 1
        parts.append(
            float(nrmse_fit(measured - measured.mean(), modelled - modelled.mean())[0]) if moving else float("nan")
        )
    return parts[0], parts[1]


def dominant_pole(found: Identification, sample_rate: float) -> Pole:
    """The slowest oscillating pole pair of the model's loop, of the second copy."""
    assert found.closed_loop_poles is not None  # the data are of the bearing's loop
    swinging = found.closed_loop_poles[found.closed_loop_poles.imag > 0.0]
    rates = np.log(swinging) * sample_rate / (2.0 * np.pi)
    slowest = rates[np.argmin(np.abs(rates))]
    return Pole(float(np.abs(slowest)), float(slowest.imag))


def linear_claim(fits: Mapping[str, tuple[float, float]]) -> Claim:
    """Whether the model follows the bearing in region A, and deviates beyond."""
    follows = [inside > 70.0 for inside, _ in fits.values()]
    departs = [beyond < inside - 20.0 for inside, beyond in fits.values()]
    return Claim(
        id="one-axis-linear-model",
        paper_figure="Fig. 2",
        statement="At low frequencies the bearing behaves as the identified linear model does, like a low-pass; as "
        "the frequency rises it deviates from it.",
        finding="; ".join(
            f"{name}: the model fits the rotor's motion in region A to {inside:z.0f} %, beyond it to {beyond:z.0f} %"
            for name, (inside, beyond) in fits.items()
        ),
        verdict=_verdict(follows + departs),
        reason="" if all(follows + departs) else "The model is worse in region A, or better beyond, than stated.",
        figure="fig2",
    )


def order_claim(paper: SweptBearing, slow: SweptBearing) -> Claim:
    """Whether A, B, C and D come in this order."""
    verdict, reason = order_verdict(paper, slow)
    return Claim(
        id="one-axis-regions",
        paper_figure="Fig. 2",
        statement="With rising frequency the bearing is first linear (A), then its bias drifts (B), then, abruptly, "
        "it oscillates much more slowly than its input (C).",
        finding=f"table 1: {paper.summary}; slow amplifier: {slow.summary}",
        verdict=verdict,
        reason=reason,
        figure="fig2-slow-amplifier",
    )


def frequency_claim(bearing: SweptBearing, pole: Pole) -> Claim:
    """Whether the slow oscillation has the frequency of the dominant pole."""
    states = bearing.states_in(Region.C)
    frequency = (
        float(np.median([state.axis("y").oscillation_frequency for state in states])) if states else float("nan")
    )
    near = [abs(frequency / other - 1.0) < NEAR for other in (pole.damped, pole.natural)]
    finding = (
        f"the slow oscillation has {frequency:.0f} Hz (median; slow amplifier), the dominant pole of the model's loop "
        f"{pole.damped:.1f} Hz damped, {pole.natural:.1f} Hz undamped"
        if states
        else "no slow oscillation"
    )
    return Claim(
        id="slow-oscillation-frequency",
        paper_figure="Fig. 2",
        statement="The slow oscillation has about the frequency of the dominant pole of the linear closed loop.",
        finding=finding,
        verdict=_verdict(near),
        reason=""
        if all(near)
        else "It is farther than a quarter from the damped or the undamped frequency, or there is none.",
        figure="fig2-slow-amplifier",
    )


def delevitation_claim(bearings: Mapping[str, SweptBearing]) -> Claim:
    """Whether D follows the other regions."""
    last = [
        Region.D in bearing.onsets and bearing.onsets[Region.D].step == max(o.step for o in bearing.onsets.values())
        for bearing in bearings.values()
    ]
    return Claim(
        id="one-axis-delevitation",
        paper_figure="Fig. 2",
        statement="If the frequency rises further, the bearing delevitates (D).",
        finding="; ".join(f"{name}: {bearing.summary}" for name, bearing in bearings.items()),
        verdict=_verdict(last),
        reason="" if all(last) else "Not every bearing delevitates within the sweep.",
        figure="fig2",
    )


def _verdict(agreements: Sequence[bool]) -> Answer:
    return "agrees" if all(agreements) else "agrees in part" if any(agreements) else "does not agree"

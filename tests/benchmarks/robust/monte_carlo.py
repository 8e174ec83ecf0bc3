"""Coverage of the bounds: models identified from many experiments on known plants, and the truth in their bounds."""

from __future__ import annotations

import numpy as np

from amb_core.ground.errors import IdentificationError
from amb_core.identification import IdentificationData, identify
from amb_core.identification.uncertainty import ModelUncertainty
from amb_core.linear import LinearSystem
from amb_core.linear.model import StateSpaceModel
from amb_core.robustness import Feedback, RobustnessSettings, feedback_of, peak_gain
from amb_core.robustness.ellipsoid import PlantSet, gap_objective
from amb_core.robustness.worst_cases import WorstCases
from tests.benchmarks.ident import plant
from tests.benchmarks.ident.linear_loop import multisine
from tests.benchmarks.ident.rotors import rotor4
from tests.benchmarks.robust.records import Size, records

GRID = np.unique(np.concatenate([np.geomspace(0.5, 4_999.0, 150), np.linspace(30.0, 300.0, 60)]))  # Hz
QUANTILE = 0.99
SAMPLED_RUNS = 6


class Bearing:
    """The 2x2 bearing of order 10 of the identification benchmark."""

    name = "bearing 2x2"
    true = property(lambda self: plant.true_model())

    def data(self, seed: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        record = plant.record(plant.Experiment("multisine", 1.0, steps), seed)
        return record.current, record.position

    def feedback(self, model) -> Feedback:
        return feedback_of(model, plant.CONTROLLER)


class Rotor:
    """The gyroscopic 4x4 rotor of order 12."""

    name = "rotor 4x4"
    true = property(lambda self: rotor4().true_model)

    def data(self, seed: int, steps: int) -> tuple[np.ndarray, np.ndarray]:
        reference = multisine(4, steps, np.random.default_rng([seed, 0]))
        return rotor4().run(reference, np.random.default_rng([seed, 1]))

    def feedback(self, model) -> Feedback:
        return Feedback(model, rotor_controller(), tuple(model.output_names))


def rotor_controller() -> LinearSystem:
    """The PD law of `LinearLoop`, from positions to -currents."""
    loop = rotor4()
    weight, eye, none = (1.0 - loop.keep) / 1e-4, np.eye(4), np.zeros((4, 4))
    proportional, derivative = np.diag(loop.proportional), np.diag(loop.derivative)
    return LinearSystem(
        np.block([[loop.keep * eye, -weight * eye], [none, none]]),
        np.vstack([weight * eye, eye]),
        np.hstack([loop.keep * derivative, -weight * derivative]),
        proportional + weight * derivative,
        1e-4,
    )


def measured(case: Bearing | Rotor, seed: int, size: Size) -> dict[str, object]:
    """One experiment: the model is identified from the data alone, of known order, and the truth sought in bounds."""
    true = case.true
    data = IdentificationData.from_arrays(*case.data(seed, size.steps), true.sample_time)
    try:
        identification = identify(data, order=true.order)
    except IdentificationError as problem:
        return {"failed": str(problem)}
    model, uncertainty = identification.model, identification.uncertainty
    feedback = case.feedback(model)
    search = WorstCases(feedback, uncertainty, PlantSet.of(uncertainty, GRID), RobustnessSettings())
    bounds = [search.axis(axis, name).sensitivity.value for axis, name in enumerate(feedback.axes)]
    apart, poles = search.gap(), search.poles()
    record = {
        "peaks_inside": [axis_peak(case.feedback(true), axis) <= bound for axis, bound in enumerate(bounds)],
        "gap_inside": gap(feedback, apart.scale, true) <= apart.worst.value,
        "poles_inside": poles_inside(uncertainty, true),
        "distance": uncertainty.distance,
        "inflation": uncertainty.inflation,
        "drift": identification.drift is not None,
    }
    if seed < SAMPLED_RUNS:
        drawn = uncertainty.samples(size.sampled, seed)
        loops = [case.feedback(one) for one in drawn]
        middle = np.array([axis_peak(feedback, axis) for axis in range(len(bounds))])
        peaks = np.array([[axis_peak(one, axis) for axis in range(len(bounds))] for one in loops])
        sampled = np.quantile(peaks, QUANTILE, axis=0) - middle
        record["width_ratios"] = ((np.array(bounds) - middle) / sampled).tolist()
        gaps = [gap(feedback, apart.scale, one) for one in drawn]
        record["gap_width_ratio"] = apart.worst.value / float(np.quantile(gaps, QUANTILE))
        fastest = np.quantile([np.abs(one.poles()[0]) for one in drawn], QUANTILE) - np.abs(model.poles()[0])
        record["pole_width_ratio"] = float((poles[0].highest - np.abs(model.poles()[0])) / fastest)
    return record


def poles_inside(uncertainty: ModelUncertainty, true: StateSpaceModel) -> bool:
    """Whether all true unstable poles lie in the joint 99 % regions of the estimated ones nearest to them."""
    groups = uncertainty.unstable_poles
    wanted = [complex(pole) for pole in true.poles() if abs(pole) > 1.0 and pole.imag >= 0.0]
    confidence = 1.0 - (1.0 - QUANTILE) / len(wanted)
    nearest = [min(groups, key=lambda group: np.abs(group.poles - pole).min()) for pole in wanted]
    return all(group.holds(pole, confidence) for group, pole in zip(nearest, wanted, strict=True))


def coverage(case: Bearing | Rotor, size: Size) -> dict[str, float]:
    """How often the true values lie in the bounds, and how wide these are compared with sampled ones."""
    done = records(f"coverage {case.name}", size, size.runs, lambda seed: measured(case, seed, size))
    kept = [item for item in done if "failed" not in item]
    by_axis = np.sum([item["peaks_inside"] for item in kept], axis=0)
    sampled = [item for item in kept if "width_ratios" in item]
    widths = np.concatenate([item["width_ratios"] for item in sampled])
    return {
        "runs": size.runs,
        "without_model": len(done) - len(kept),
        "inside": sum(all(item["peaks_inside"]) for item in kept),
        "inside_by_axis": by_axis.tolist(),
        "gap_inside": sum(item["gap_inside"] for item in kept),
        "poles_inside": sum(item["poles_inside"] for item in kept),
        "sampled_runs": len(sampled),
        "width_ratio": float(np.median(widths)),
        "width_ratio_worst": float(widths.max()),
        "gap_width_ratio": float(np.median([item["gap_width_ratio"] for item in sampled])),
        "pole_width_ratio": float(np.median([item["pole_width_ratio"] for item in sampled])),
        "largest_distance": float(np.max([item["distance"] for item in kept])),
        "drift_removed": sum(item["drift"] for item in kept),
        "not_white": sum(not 0.8 < item["inflation"] < 1.25 for item in kept),
    }


def axis_peak(feedback: Feedback, axis: int) -> float:
    """Peak of |S| of an axis."""
    one = [feedback.inputs + axis]
    return peak_gain(feedback.closed.part(one, one)).value


def gap(feedback: Feedback, scale: float, other) -> float:
    """nu-gap of a model to the plant of a loop."""
    nominal = feedback.plant.response(GRID)
    change = other.response(GRID) - nominal
    return float(gap_objective(nominal, scale)(change, np.arange(len(GRID)))[0].max())

"""Coverage of the bounds: models identified from many experiments on known plants, and the truth in their bounds."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "ident"))  # its modules import each other by name

import plant
from linear_loop import multisine
from rotors import rotor4
from scipy.stats import chi2

from amb_core.identification import IdentificationData, estimate_uncertainty
from amb_core.identification.estimate.pem import pem
from amb_core.robustness import Feedback, Lti, RobustnessSettings, feedback_of, peak_gain
from amb_core.robustness.assessment import WorstCases
from amb_core.robustness.ellipsoid import PlantSet, gap_objective
from amb_core.robustness.feedback import plant_of

STEPS = 10_000
GRID = np.unique(np.concatenate([np.geomspace(0.5, 4_999.0, 150), np.linspace(30.0, 300.0, 60)]))  # Hz
SAMPLED = 200  # models of the sampled bound
SAMPLED_RUNS = 4


class Bearing:
    """The 2x2 bearing of order 10 of the identification benchmark."""

    name = "bearing 2x2"
    true = property(lambda self: plant.true_model())

    def data(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        record = plant.record(plant.Experiment("multisine", 1.0, STEPS), seed)
        return record.current, record.position

    def feedback(self, model) -> Feedback:
        return feedback_of(model, plant.CONTROLLER)


class Rotor:
    """The gyroscopic 4x4 rotor of order 12."""

    name = "rotor 4x4"
    true = property(lambda self: rotor4().true_model)

    def data(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        reference = multisine(4, STEPS, np.random.default_rng([seed, 0]))
        return rotor4().run(reference, np.random.default_rng([seed, 1]))

    def feedback(self, model) -> Feedback:
        return Feedback(plant_of(model), rotor_controller(), tuple(model.output_names))


def rotor_controller() -> Lti:
    """The PD law of `LinearLoop`, from positions to -currents."""
    loop = rotor4()
    weight, eye, none = (1.0 - loop.keep) / 1e-4, np.eye(4), np.zeros((4, 4))
    proportional, derivative = np.diag(loop.proportional), np.diag(loop.derivative)
    return Lti(
        np.block([[loop.keep * eye, -weight * eye], [none, none]]),
        np.vstack([weight * eye, eye]),
        np.hstack([loop.keep * derivative, -weight * derivative]),
        proportional + weight * derivative,
        1e-4,
    )


def coverage(case: Bearing | Rotor, runs: int, say) -> dict[str, float]:
    """How often the true values lie in the bounds, and how wide these are compared with sampled ones."""
    true, settings = case.true, RobustnessSettings()
    ideal = [axis_peak(case.feedback(true), axis) for axis in range(len(true.c))]
    counted = {"peak": 0, "gap": 0, "poles": 0}
    widths: list[float] = []
    gap_widths: list[float] = []
    poles = 0
    for seed in range(runs):
        inputs, outputs = case.data(seed)
        model = pem(inputs, outputs, true)
        uncertainty = estimate_uncertainty(model, IdentificationData.from_arrays(inputs, outputs, true.sample_time))
        feedback = case.feedback(model)
        found = WorstCases(feedback, uncertainty, PlantSet.of(uncertainty, GRID), settings)
        bounds, apart = [found.axis(axis, name) for axis, name in enumerate(feedback.axes)], found.gap()
        counted["peak"] += all(value <= item.sensitivity.value for value, item in zip(ideal, bounds, strict=True))
        counted["gap"] += gap(feedback, apart.scale, true) <= apart.worst.value
        unstable = [pole for pole in true.poles() if abs(pole) > 1.0]
        for pole in unstable:
            nearest = int(np.argmin(np.abs(model.poles() - pole)))
            error = model.poles()[nearest] - pole
            spread = uncertainty.pole_covariance[nearest]
            real = abs(pole.imag) < 1e-12
            inside = (
                error.real**2 / spread[0, 0] <= chi2.ppf(0.99, 1)
                if real
                else _mahalanobis(error, spread) <= chi2.ppf(0.99, 2)
            )
            poles, counted["poles"] = poles + 1, counted["poles"] + bool(inside)
        if seed < SAMPLED_RUNS:
            drawn = uncertainty.samples(SAMPLED, seed)
            for axis, item in enumerate(bounds):
                sampled = np.quantile([axis_peak(case.feedback(one), axis) for one in drawn], 0.99)
                middle = axis_peak(feedback, axis)
                widths.append((item.sensitivity.value - middle) / (sampled - middle))
            sampled = np.quantile([gap(feedback, apart.scale, one) for one in drawn], 0.99)
            gap_widths.append(apart.worst.value / float(sampled))
        if seed % 10 == 9:
            say(f"coverage {case.name}: {seed + 1} runs, {counted}, widths {np.median(widths):.3f}")
    return {
        "runs": runs,
        "inside": counted["peak"],
        "width_ratio": float(np.median(widths)),
        "width_ratio_worst": float(np.max(widths)),
        "gap_inside": counted["gap"],
        "gap_width_ratio": float(np.median(gap_widths)),
        "poles": poles,
        "poles_inside": counted["poles"],
    }


def axis_peak(feedback: Feedback, axis: int) -> float:
    """Peak of |S| of an axis."""
    one = [feedback.inputs + axis]
    return peak_gain(feedback.closed.part(one, one)).value


def gap(feedback: Feedback, scale: float, other) -> float:
    """nu-gap of a model to the plant of a loop."""
    nominal = feedback.plant.response(GRID)
    change = plant_of(other).response(GRID) - nominal
    return float(gap_objective(nominal, scale)(change, np.arange(len(GRID)))[0].max())


def _mahalanobis(error: complex, spread: np.ndarray) -> float:
    parts = np.array([error.real, error.imag])
    return float(parts @ np.linalg.solve(spread, parts))

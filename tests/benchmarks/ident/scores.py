"""How close an identified model comes to the true plant: what the table of the benchmark shows."""

from __future__ import annotations

import functools

import numpy as np
import plant
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.identification import StateSpaceModel, closed_loop_poles, nrmse_fit, simulate_closed_loop

VALIDATION_STEPS = 20_000
_VALIDATION_SEED = 1_000_000  # far from those of the data
_FREQUENCIES = np.arange(5.0, 1_001.0)  # Hz, dense enough for resonances and antiresonances of 0.5 % damping
_POLE_TOLERANCE = 2e-3

_DIVERGED: dict[str, float | bool] = {
    "fit_squares": -np.inf,
    "fit_multisine": -np.inf,
    "frf_max_percent": np.inf,
    "frf_below_500_percent": np.inf,
    "unstable_poles_right": False,
    "closed_loop_stable": False,
}

Matrices = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def score(matrices: Matrices) -> dict[str, float | bool]:
    """Scores of a model's A, B, C; a model that is not finite scores as one whose loop diverges.

    fit_squares, fit_multisine (percent): NRMSE fit, of the worse axis, of the closed loop of model and controller, from
    rest, to the true closed loop without noise, on squares and on a multisine that no method has seen.
    frf_max_percent, frf_below_500_percent: largest error from 5 to 1000 Hz, and below 500 Hz, of the frequency response
    in the spectral norm, relative to that of the true response at the same frequency.
    unstable_poles_right: two unstable poles, each within 2e-3 of the true ones. closed_loop_stable: all poles inside.
    """
    if not all(np.all(np.isfinite(matrix)) for matrix in matrices):
        return _DIVERGED
    model = _model(*matrices)
    error = response_error(model)
    return {
        "fit_squares": _fit(model, "squares"),
        "fit_multisine": _fit(model, "multisine"),
        "frf_max_percent": 100.0 * float(error.max()),
        "frf_below_500_percent": 100.0 * float(error[_FREQUENCIES < 500.0].max()),
        "unstable_poles_right": _unstable_poles_right(model),
        "closed_loop_stable": bool(np.all(np.abs(closed_loop_poles(model, plant.CONTROLLER)) < 1.0)),
    }


def response_error(model: StateSpaceModel) -> NDArray[np.float64]:
    """Relative error of the frequency response, shape (frequencies,)."""
    true = _true_response()
    return np.linalg.norm(_response(model) - true, axis=(1, 2), ord=2) / np.linalg.norm(true, axis=(1, 2), ord=2)


def innovation_ratio(covariance: NDArray[np.float64], noise: float) -> float:
    """Rms of a model's innovations over that of the true Kalman filter's, of the axis where it is further from 1."""
    ratios = np.sqrt(np.diag(covariance) / np.diag(plant.true_model(noise).innovation_covariance))
    return float(ratios[np.argmax(np.abs(np.log(ratios)))])


def _model(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> StateSpaceModel:
    zero, order = np.zeros(2), len(a)
    return StateSpaceModel(
        a, b, c, np.zeros((2, 2)), np.zeros((order, 2)), np.eye(2), zero, zero, np.zeros(order), plant.SAMPLE_TIME
    )


def _response(model: StateSpaceModel) -> NDArray[np.complex128]:
    z = np.exp(2j * np.pi * _FREQUENCIES * plant.SAMPLE_TIME)
    resolvent = z[:, np.newaxis, np.newaxis] * np.eye(model.order) - model.a
    return np.asarray(model.c @ np.linalg.solve(resolvent, np.broadcast_to(model.b, (len(z), *model.b.shape))))


@functools.cache
def _true_response() -> NDArray[np.complex128]:
    return _response(plant.true_model())


def _fit(model: StateSpaceModel, excitation: str) -> float:
    true = plant.record(plant.Experiment(excitation, 0.0, VALIDATION_STEPS), _VALIDATION_SEED)
    try:
        simulated = simulate_closed_loop(model, plant.CONTROLLER, true.reference)
    except IdentificationError:
        return -np.inf
    return float(nrmse_fit(true.position, simulated.position).min())


def _unstable_poles_right(model: StateSpaceModel) -> bool:
    true, found = plant.true_model().unstable_poles(), model.unstable_poles()
    if len(found) != len(true):
        return False
    return bool(np.all(np.abs(np.sort_complex(found) - np.sort_complex(true)) < _POLE_TOLERANCE))

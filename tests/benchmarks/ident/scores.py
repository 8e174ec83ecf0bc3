"""How close an identified model comes to the true plant: what the table of the benchmark shows."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from amb_core.ground.errors import IdentificationError
from amb_core.identification import StateSpaceModel, nrmse_fit
from tests.benchmarks.ident.cases import CASES, Case, validation
from tests.benchmarks.ident.linear_loop import SAMPLE_TIME, model_of

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


def score(matrices: Matrices, data_set: str = "squares") -> dict[str, float | bool]:
    """Scores of a model's A, B, C; a model that is not finite scores as one whose loop diverges.

    fit_squares, fit_multisine (percent): NRMSE fit, of the worst axis, of the closed loop of model and controller, from
    rest, to the true closed loop without noise, on squares and on a multisine that no method has seen.
    frf_max_percent, frf_below_500_percent: largest error from 5 to 1000 Hz, and below 500 Hz, of the frequency response
    in the spectral norm, relative to that of the true response at the same frequency.
    unstable_poles_right: as many unstable poles as the plant, each within 2e-3 of the plant's. closed_loop_stable: all
    poles inside.
    """
    if not all(np.all(np.isfinite(matrix)) for matrix in matrices):
        return _DIVERGED
    case, model = CASES[data_set], model_of(*matrices)
    error = response_error(model, data_set)
    return {
        "fit_squares": _fit(model, case, "squares"),
        "fit_multisine": _fit(model, case, "multisine"),
        "frf_max_percent": 100.0 * float(error.max()),
        "frf_below_500_percent": 100.0 * float(error[_FREQUENCIES < 500.0].max()),
        "unstable_poles_right": _unstable_poles_right(model, case),
        "closed_loop_stable": bool(np.all(np.abs(case.poles(model)) < 1.0)),
    }


def response_error(model: StateSpaceModel, data_set: str = "squares") -> NDArray[np.float64]:
    """Relative error of the frequency response, shape (frequencies,)."""
    true = _true_response(data_set)
    return np.linalg.norm(_response(model) - true, axis=(1, 2), ord=2) / np.linalg.norm(true, axis=(1, 2), ord=2)


def innovation_ratio(covariance: NDArray[np.float64], data_set: str) -> float:
    """Rms of a model's innovations over that of the true Kalman filter's, of the axis where it is further from 1."""
    ratios = np.sqrt(np.diag(covariance) / np.diag(CASES[data_set].true.innovation_covariance))
    return float(ratios[np.argmax(np.abs(np.log(ratios)))])


def _response(model: StateSpaceModel) -> NDArray[np.complex128]:
    z = np.exp(2j * np.pi * _FREQUENCIES * SAMPLE_TIME)
    resolvent = z[:, np.newaxis, np.newaxis] * np.eye(model.order) - model.a
    return np.asarray(model.c @ np.linalg.solve(resolvent, np.broadcast_to(model.b, (len(z), *model.b.shape))))


@functools.cache
def _true_response(data_set: str) -> NDArray[np.complex128]:
    return _response(CASES[data_set].true)


def _fit(model: StateSpaceModel, case: Case, excitation: str) -> float:
    reference, true = validation(case.name, excitation)
    try:
        with np.errstate(all="ignore"):
            return float(nrmse_fit(true, case.simulate(model, reference)).min())
    except IdentificationError:  # it diverges
        return -np.inf


def _unstable_poles_right(model: StateSpaceModel, case: Case) -> bool:
    true, identified = case.true.unstable_poles(), model.unstable_poles()
    if len(identified) != len(true):
        return False
    apart = np.abs(np.subtract.outer(identified, true))
    return bool(np.all(apart[linear_sum_assignment(apart)] < _POLE_TOLERANCE))

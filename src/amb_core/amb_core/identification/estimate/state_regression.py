"""What the subspace methods SSARX, PBSID and CVA share: horizons, choice of the ridge, and the last regressions.

Each method gives a map from the past of inputs and outputs to the state; least squares on the state then give the
predictor. Direct feedthrough is zero unless asked for: a bearing's position responds after the current reference.

The length of the past is that of the autoregressive model with the best Akaike criterion. Without a ridge, band-limited
data leave the map undetermined. The chosen ridge gives the state-space model with the smallest one-step prediction
errors on the data.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.data_triangle import DataTriangle, PastRegression
from amb_core.identification.estimate.predictor import experiments, fit_input_matrix, innovations, kalman_gain
from amb_core.identification.estimate.scaled_data import Samples, ScaledData, check_order
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import small_matrices, thin_svd

_LONGEST_PAST = 60  # steps; the memory of a bearing's predictor is shorter, unless there is nearly no noise
_SAMPLES_PER_STEP = 20  # at least, so that short data leave the long ARX model enough freedom
_LEAST_STRENGTH = 1e-12  # of a state, relative to the strongest; weaker ones are rounding
RIDGES = np.logspace(-14, -2, 13)  # relative to the largest eigenvalue of the past's covariance

# From the past's regression and a ridge to the map from past to state before weighting: rows z[k-1] ... z[k-past],
# columns the predicted future outputs, weighted so that their strongest directions are the states to keep.
FutureMap = Callable[[PastRegression, float], NDArray[np.float64]]


def identify_by_states(
    inputs: Samples,
    outputs: Samples,
    sample_time: float,
    order: int,
    past: int | None,
    future: int | None,
    source: str,
    method: str,
    future_map: FutureMap,
    feedthrough: bool = False,
) -> StateSpaceModel:
    """The model of a method, which is defined by its map from the past to the weighted future.

    Parameters and errors are those of `ssarx`.
    """
    data = _checked(inputs, outputs, order)
    with small_matrices(f"no model of order {order} from {len(data.inputs)} samples"):
        regression = _regression(data, order, past, future, feedthrough)
        predictor = best_predictor(data, regression, order, future_map)
        return _model(data, predictor, sample_time, method, source, feedthrough)


def models_of_all_ridges(
    inputs: Samples,
    outputs: Samples,
    sample_time: float,
    order: int,
    method: str,
    future_map: FutureMap,
    feedthrough: bool = False,
) -> list[StateSpaceModel]:
    """The models of a method with every ridge that gives one, none or several.

    Parameters and errors are those of `identify_by_states`.
    """
    data, models = _checked(inputs, outputs, order), []
    with small_matrices(f"no model of order {order} from {len(data.inputs)} samples"):
        regression = _regression(data, order, None, None, feedthrough)
        for ridge in RIDGES:
            try:
                a, _, c, _, k = predictor_matrices(regression, future_map(regression, float(ridge)), order)
            except IdentificationError:
                continue
            models.append(_model(data, (a, c, k), sample_time, method, "", feedthrough))
    return models


def _checked(inputs: Samples, outputs: Samples, order: int) -> ScaledData:
    check_order(order)
    return ScaledData.of(inputs, outputs)


def _regression(
    data: ScaledData, order: int, past: int | None, future: int | None, feedthrough: bool
) -> PastRegression:
    longest, future = horizons(data, order, past, future)
    triangle = DataTriangle(data, longest, future, feedthrough)
    used = triangle.best_past(shortest_horizon(order, data.outputs.shape[1])) if past is None else past
    return PastRegression(triangle, used)


def _model(
    data: ScaledData,
    predictor: tuple[NDArray[np.float64], ...],
    sample_time: float,
    method: str,
    source: str,
    feedthrough: bool,
) -> StateSpaceModel:
    a, c, k = predictor
    b, d, initial_states = fit_input_matrix(a, c, k, data.inputs, data.outputs, data.lengths, feedthrough)
    return data.model(a, b, c, k, initial_states, sample_time, method, source, d)


def shortest_horizon(order: int, outputs: int) -> int:
    """Fewest steps of past and of future in which that many outputs distinguish that many states."""
    return math.ceil(order / outputs) + 1


def horizons(data: ScaledData, order: int, past: int | None = None, future: int | None = None) -> tuple[int, int]:
    """The longest past and the future (steps) to use for an order, if they are not given.

    Raises
    ------
    IdentificationError
        If a horizon is too short for the order, or the samples are too few.
    """
    steps = len(data.inputs)
    shortest = shortest_horizon(order, data.outputs.shape[1])
    longest = max(shortest, min(_LONGEST_PAST, steps // _SAMPLES_PER_STEP)) if past is None else past
    future = max(shortest, 2 * order) if future is None else future
    for name, horizon in (("past", longest), ("future", future)):
        if horizon < shortest:
            raise IdentificationError(
                f"{name} {horizon} is not allowed; allowed: at least {shortest} for order {order}"
            )
    usable = sum(max(length - longest - future, 0) for length in data.lengths)
    needed = (data.inputs.shape[1] + data.outputs.shape[1]) * (longest + future + 1) + 1
    if usable < needed:
        lost = f", each less {longest + future} for the horizons," if len(data.lengths) > 1 else ""
        needed += longest + future if len(data.lengths) == 1 else 0
        raise IdentificationError(f"{steps} samples{lost} are too few for order {order}; at least {needed} are needed")
    return longest, future


def best_predictor(
    data: ScaledData, regression: PastRegression, order: int, future_map: FutureMap
) -> tuple[NDArray[np.float64], ...]:
    """A, C and K of the ridge with the smallest one-step prediction errors."""
    best, least, reason = None, math.inf, IdentificationError(f"no ridge gives a predictor of order {order}")
    for ridge in RIDGES:
        try:
            a, b, c, d, k = predictor_matrices(regression, future_map(regression, float(ridge)), order)
        except IdentificationError as problem:
            reason = problem
            continue
        direct = d if regression.triangle.feedthrough else None
        errors = innovations(a, b, c, k, np.zeros(order), data.inputs, data.outputs, data.lengths, direct)
        errors = np.vstack([errors[part][regression.steps :] for part in experiments(len(errors), data.lengths)])
        size = float(np.linalg.slogdet(errors.T @ errors)[1])
        if size < least:
            best, least = (a, c, k), size
    if best is None:
        raise reason
    return best


def predictor_matrices(
    regression: PastRegression, future_map: NDArray[np.float64], order: int
) -> tuple[NDArray[np.float64], ...]:
    """A, B, C, D and the Kalman gain K from the result of a `FutureMap`.

    Raises
    ------
    IdentificationError
        If the data show fewer states, or no Kalman gain exists.
    """
    triangle, steps = regression.triangle, regression.steps
    directions, strengths, _ = thin_svd((regression.columns @ future_map).T)
    if not strengths[order - 1] > _LEAST_STRENGTH * strengths[0]:
        raise IdentificationError(f"the data show fewer than {order} states; lower the order")
    strengths = strengths[:order]
    to_state = future_map @ directions[:, :order] / strengths  # states of variance 1
    z_now, state, advanced = triangle.at(0), regression.columns @ to_state, triangle.before(steps, lead=1) @ to_state
    seen = np.hstack([state, z_now[:, triangle.p :]]) if triangle.feedthrough else state
    by_seen = linalg.lstsq(seen, z_now[:, : triangle.p])[0]
    errors = z_now[:, : triangle.p] - seen @ by_seen
    c, d = by_seen[:order].T, by_seen[order:].T  # the latter without columns if there is no feedthrough
    # The controller responds within the sample, so the errors correlate with the inputs and must be regressors too.
    regressors = np.hstack([state, errors, z_now[:, triangle.p :]])
    transition = linalg.lstsq(regressors, advanced)[0]
    a, k, b = (part.T for part in np.split(transition, [order, order + triangle.p]))
    # A model of too low an order leaves residuals; with them K is the gain of the Kalman filter, which is stable.
    residuals = advanced - regressors @ transition
    r = errors.T @ errors
    # Equally observable states: the data then determine the input matrix well, even for weak states.
    ratio = np.divide.outer(strengths, strengths)
    a, b, c, k = a * ratio, b * strengths[:, np.newaxis], c / strengths, k * strengths[:, np.newaxis]
    q = residuals.T @ residuals * np.outer(strengths, strengths) + k @ r @ k.T
    return a, b, c, d, kalman_gain(a, c, q, r, k @ r)

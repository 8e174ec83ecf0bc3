"""Prediction-error identification (PEM) of the innovations form, for plants that may be unstable.

Gauss-Newton with Levenberg-Marquardt damping over the modes of the predictor, F = A - K C and C in block-diagonal
coordinates that are renewed at every step; B, K and x[0] are the least-squares solution for each F and C (variable
projection, with Kaufman's simplification of the derivative). Errors are weighted by the inverse of their covariance at
the last step, so every accepted step lowers the determinant of the covariance, which the maximum-likelihood estimate
minimises. The model is simulated only as a predictor: its F stays stable even if A is unstable.

A search may stall above the minimum: a mode of the predictor goes to the limit of stability, where most steps are
refused. At the true parameters the squared errors, relative to their variance, exceed the minimum by one for each
parameter on average. A search with such a mode that could still gain more has ended further from the minimum than the
truth is. It is then made again from a second start: the first one, refined on predictors of finite memory.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 7.4, 10.2 and 16.4; G. Golub and
V. Pereyra, Separable nonlinear least squares: the variable projection method and its applications, Inverse Problems 19
(2003); T. McKelvey, A. Helmersson and T. Ribarits, Data driven local coordinates for multivariable linear systems and
their application to system identification, Automatica 40 (2004).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.ground.errors import IdentificationError
from amb_core.identification.estimate.filter_bank import Fit, Modes, fit_gains
from amb_core.identification.estimate.finite_memory import FiniteMemory
from amb_core.identification.estimate.levenberg_marquardt import minimise
from amb_core.identification.estimate.scaled_data import Samples, ScaledData
from amb_core.identification.progress import SearchEnd
from amb_core.linear import Arrays
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import LARGEST_RADIUS, small_matrices

MOST_ITERATIONS = 80
MOST_EXPERIMENTS = 10  # each has its own first state, and time grows with the square of their number
_REFINING_GAIN = 1e-4  # likewise with finite memory: far below what a state must gain for the criterion of Schwarz
_REFINING_ITERATIONS = 12
_BESIDE_CHANCE = 0.1  # of what the true parameters leave by chance: a search that leaves less has converged
_LEAST_SCALE = 1e-1  # effect of an entry of F or C, relative to the largest: one below it moves little
_LEAST_PROGRESS = 1.0  # decrease of the squared errors over their variance: what one parameter gains by chance
_LEAST_GAIN = 1e-5  # relative decrease of the squared errors at which the search ends; far below the noise of the data


def pem(
    inputs: Samples,
    outputs: Samples,
    start: StateSpaceModel,
    progress: Callable[[int, float], None] | None = None,
    most_iterations: int = MOST_ITERATIONS,
    source: str = "",
    ended: Callable[[SearchEnd], None] | None = None,
    second_start: bool = False,
    feedthrough: bool = False,
) -> StateSpaceModel:
    """Improve a model until its one-step prediction errors on the data are minimal.

    Parameters
    ----------
    inputs, outputs : ndarray, shapes (steps, m), (steps, p), or lists of such
        Inputs and outputs of one experiment, or of each of several, in the units of `start`. Several experiments take
        more time. Means over all are removed and kept as the model's offsets.
    start : StateSpaceModel
        Where to start: gives order, sample time, A, C and K. B, D and the initial state are estimated anew.
    progress : callable, optional
        Called as progress(iteration, cost) with the start as iteration 0 and after every step tried. The cost (-) is
        the least so far of half the logarithm of the determinant of the covariance of the errors, scaled by the data's
        variances. If it raises an exception, the search ends. None for no calls.
    most_iterations : int, optional
        Steps tried, taken or not, after which the search ends, converged or not.
    source : str, optional
        Where the data come from, kept in the model.
    ended : callable, optional
        Called with the end of the search: steps tried, what a further step promises, whether it converged. None for no
        call.
    second_start : bool, optional
        Whether to search from a second start where the search stalls, and to keep the model with the smaller errors.
        Iterations of the second search follow `most_iterations`, with the least cost so far; `ended` gets the end of
        the search whose model is kept.
    feedthrough : bool, optional
        Whether outputs respond within the sample; D is then estimated, and zero otherwise.

    Returns
    -------
    StateSpaceModel
        The model with the smallest errors found; its predictor is stable and `fit` is empty.

    Raises
    ------
    IdentificationError
        If the start has an unstable predictor or does not suit the data, or the data determine no model.
    """
    data = ScaledData.of(inputs, outputs)
    if start.b.shape[1] != data.inputs.shape[1] or len(start.c) != data.outputs.shape[1]:
        raise IdentificationError(
            f"the start has {start.b.shape[1]} inputs and {len(start.c)} outputs, "
            f"the data {data.inputs.shape[1]} and {data.outputs.shape[1]}"
        )
    if len(data.lengths) > MOST_EXPERIMENTS:
        raise IdentificationError(
            f"{len(data.lengths)} experiments are not allowed; allowed: up to {MOST_EXPERIMENTS}, use the longest"
        )
    unknowns = start.order * (len(data.lengths) + 2 * data.outputs.shape[1] + data.inputs.shape[1])
    unknowns += start.d.size if feedthrough else 0
    if data.outputs.size <= unknowns:
        raise IdentificationError(
            f"{len(data.outputs)} samples are too few for the {unknowns} unknowns of order {start.order}"
        )
    radius = float(np.max(np.abs(np.linalg.eigvals(start.a - start.k @ start.c))))
    if not radius < LARGEST_RADIUS:
        raise IdentificationError(f"the start must have a stable predictor; its spectral radius is {radius:.6g}")
    # The matrices are small: more BLAS threads cost time, and take cores from the control loop.
    with small_matrices(f"no model of order {start.order} from {len(data.inputs)} samples"):
        modes = Modes.of(start.a - start.k @ start.c, start.c / data.output_scale[:, np.newaxis])

        def best(trial: Modes, weight: NDArray[np.float64]) -> Fit:
            return fit_gains(trial, data.inputs, data.outputs, weight, data.lengths, feedthrough)

        ends: list[SearchEnd] = []
        search = partial(
            fit_modes,
            best=best,
            outputs=data.outputs.shape[1],
            most_iterations=most_iterations,
            least_progress=_LEAST_PROGRESS / data.outputs.size,
        )
        fit = search(modes, progress=progress, ended=ends.append)
        if second_start and stalled(ends[0], fit, data):
            fit = _searched_again(modes, search, fit, data, progress, most_iterations, ends, feedthrough)
        if ended is not None:
            ended(_by_chance(ends[-1], fit, data))
        a, b, c, k, initial_states = fit.matrices(data.inputs.shape[1])
        d = fit.feedthrough if feedthrough else None
        return data.model(a, b, c, k, initial_states, start.sample_time, "pem", source, d, constant=True)


def fit_modes(
    modes: Modes,
    best: Callable[[Modes, NDArray[np.float64]], Fit],
    outputs: int,
    progress: Callable[[int, float], None] | None = None,
    most_iterations: int = MOST_ITERATIONS,
    least_gain: float = _LEAST_GAIN,
    ended: Callable[[SearchEnd], None] | None = None,
    hopeless: Callable[[float, float], bool] | None = None,
    first: Fit | None = None,
    least_progress: float = 0.0,
) -> Fit:
    """The fit with the smallest determinant of the errors' covariance that a search from `modes` finds.

    Parameters
    ----------
    modes : Modes
        Where to start.
    best : callable
        Called as best(modes, weight) for the best fit with these modes, its errors weighted.
    outputs : int
        Number of outputs p.
    progress, most_iterations, ended : see `pem`
    least_gain : float
        Predicted relative decrease of the squared errors at which the search ends.
    hopeless : callable, optional
        Called as hopeless(cost, predicted relative decrease of the squared errors) before each step; the search ends
        where it returns True.
    first : Fit, optional
        An earlier fit with errors of about the same covariance, for the first weight; by default one without weight.
    least_progress : float
        Relative decrease of the squared errors by the last steps taken below which the search ends.

    Raises
    ------
    LinAlgError
        If the start determines no fit.
    """
    search = minimise(
        best(modes, _weight((first or best(modes, np.eye(outputs))).covariance)),
        cost_of,
        lambda fit: (fit.sensitivity, fit.errors),
        lambda fit, step: _try(*fit.modes.moved(step), best, _weight(fit.covariance)),
        progress,
        most_iterations,
        least_gain,
        _LEAST_SCALE,
        lambda before, after: 2.0 * (before - after) / outputs,
        hopeless,
        least_progress,
    )
    if ended is not None:
        ended(SearchEnd(search.iterations, search.left, search.left < least_gain))
    return search.point


def refine(modes: Modes, memory: FiniteMemory) -> Fit | None:
    """The fit that a short search on predictors of finite memory finds; None if the data determine none."""
    try:
        return fit_modes(modes, memory.best, memory.outputs.shape[1], None, _REFINING_ITERATIONS, _REFINING_GAIN)
    except linalg.LinAlgError:
        return None


def stalled(end: SearchEnd, fit: Fit, data: ScaledData) -> bool:
    """Whether a search ended further above the minimum than the true parameters are, with a mode that does not fade.

    Without such a mode, large gains that remain are those of a model too simple for data with little noise, such as
    those of a simulated nonlinear bearing. Another start does not help there.
    """
    lasts = fit.modes.radius ** max(data.lengths) > math.exp(-1.0)  # a time constant as long as the data
    return lasts and end.left * data.outputs.size > _parameters(fit, data)


def _parameters(fit: Fit, data: ScaledData) -> int:
    """Parameters of a model, without those of coordinates."""
    return fit.modes.order * (data.inputs.shape[1] + 2 * data.outputs.shape[1])


def _by_chance(end: SearchEnd, fit: Fit, data: ScaledData) -> SearchEnd:
    """The end of a search, converged also where the true parameters would leave far more to gain, by chance."""
    little = end.left * data.outputs.size <= _BESIDE_CHANCE * _parameters(fit, data)
    return replace(end, converged=end.converged or little)


def _searched_again(
    modes: Modes,
    search: Callable[..., Fit],
    first: Fit,
    data: ScaledData,
    progress: Callable[[int, float], None] | None,
    most_iterations: int,
    ends: list[SearchEnd],
    feedthrough: bool,
) -> Fit:
    """The better of the first fit and that of a search from the second start, whose end is then added to the ends."""
    least = cost_of(first)

    def tell(iteration: int, cost: float) -> None:
        if progress is not None:
            progress(most_iterations + iteration, min(cost, least))

    try:
        start = refine(modes, FiniteMemory.whole(data, feedthrough))
        if start is None:
            return first
        ends_again: list[SearchEnd] = []
        second = search(start.modes, progress=tell, ended=ends_again.append, first=start)
    except linalg.LinAlgError:  # the first fit stands
        return first
    if not cost_of(second) < least:
        return first
    ends += ends_again
    return second


def _try(f: Arrays, c: Arrays, best: Callable[[Modes, Arrays], Fit], weight: Arrays) -> Fit | None:
    """The fit with these matrices of the predictor, in renewed coordinates; None if it is not stable."""
    try:
        if not np.max(np.abs(np.linalg.eigvals(f))) < LARGEST_RADIUS:
            return None
        return best(Modes.of(f, c), weight)
    except linalg.LinAlgError:
        return None


def cost_of(fit: Fit) -> float:
    """Half the logarithm of the determinant of the covariance of the errors."""
    return 0.5 * float(np.linalg.slogdet(fit.covariance)[1])


def _weight(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Inverse Cholesky factor: weighted errors have the unit matrix as covariance."""
    factor = linalg.cholesky(covariance, lower=True)
    return np.asarray(linalg.solve_triangular(factor, np.eye(len(covariance)), lower=True))

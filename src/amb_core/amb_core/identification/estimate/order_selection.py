"""How many states the data show: singular values, the criteria of Akaike and Schwarz, cross-validation.

The criteria weigh the size of the one-step prediction errors against the number of parameters. They hold for estimates
of maximum likelihood. Subspace models are not such estimates: with them the criteria prefer too many states. So each
order's subspace model is refined as in `pem`, on predictors of finite memory (see `finite_memory`), which takes a few
milliseconds per iteration. Every order uses the same two factors of the data.

Predictors of a lightly damped plant have a longer memory. Truncated, that of the true order is not the best, and more
states compensate for the truncation. So the best order and its neighbours are compared again with `pem` models of all
samples, started from those of finite memory. The search of an order ends as soon as it cannot become the best one.

Sources: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, sections 16.4 and 16.6; G. Schwarz, Estimating
the dimension of a model, Annals of Statistics 6 (1978).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.data.experiments import IdentificationData
from amb_core.data.experiments.checks import highest_excited_order
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind, whole_numbers
from amb_core.identification.estimate.data_triangle import DataTriangle, PastRegression
from amb_core.identification.estimate.filter_bank import Fit, Modes, fit_gains
from amb_core.identification.estimate.finite_memory import FiniteMemory, halves, memory_of
from amb_core.identification.estimate.order_progress import OrderProgress
from amb_core.identification.estimate.pem import MOST_EXPERIMENTS, cost_of, fit_modes, refine
from amb_core.identification.estimate.scaled_data import ScaledData, check_order
from amb_core.identification.estimate.ssarx import future_map
from amb_core.identification.estimate.state_regression import (
    RIDGES,
    horizons,
    predictor_matrices,
    shortest_horizon,
)
from amb_core.identification.progress import Cancelled, Progress, Watch
from amb_core.linear.numerics import LARGEST_RADIUS, small_matrices

HIGHEST = 14
"""The highest order tested by default."""

_REACH = 2  # orders on either side that are compared with the best one: those of one mode less or more
_RIDGES = RIDGES[::3]
_MOST_ITERATIONS = 100  # of a search that still has hope: an order judged too early looks worse than it is
_HOPE = 2.0  # a search may lower the criterion by as many times what its next step promises


@dataclass(frozen=True)
class OrderSelection:
    """Criteria over the order of the model.

    Attributes
    ----------
    orders : tuple of int
        The orders tested, rising.
    singular_values : ndarray, shape (values,)
        How strongly each state shows in the future outputs, relative to the strongest (-): those of the subspace
        method.
    aic, bic : ndarray, shape (orders,)
        Criteria of Akaike and of Schwarz, minus their smallest values (-); infinite if the order has no model.
    validation_error : ndarray, shape (orders,)
        Cross-validation (-): one-step prediction error, on half the data, of the model estimated from the other half;
        rms relative to the signals', geometric mean over the outputs. Infinite if the order has no model.
    """

    orders: tuple[int, ...]
    singular_values: NDArray[np.float64]
    aic: NDArray[np.float64]
    bic: NDArray[np.float64]
    validation_error: NDArray[np.float64]

    @property
    def chosen(self) -> int:
        """The order with the smallest criterion of Schwarz."""
        return self._best(self.bic)

    @property
    def best_by_aic(self) -> int:
        """The order with the smallest criterion of Akaike; it tends to have too many states."""
        return self._best(self.aic)

    @property
    def best_by_validation(self) -> int:
        """The order with the smallest validation error."""
        return self._best(self.validation_error)

    @property
    def at_the_end(self) -> bool:
        """Whether the chosen order is the highest of several tested ones; a higher one may then be better."""
        return len(self.orders) > 1 and self.chosen == self.orders[-1]

    def _best(self, criterion: NDArray[np.float64]) -> int:
        return self.orders[int(np.argmin(criterion))]


def select_order(
    data: IdentificationData,
    orders: Sequence[int] | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    feedthrough: bool = False,
) -> OrderSelection:
    """Compare models of several orders.

    Parameters
    ----------
    data : IdentificationData
        Data of the plant, in open or closed loop.
    orders : sequence of int, optional
        The orders to test; by default all from 1 to `HIGHEST` for which there are enough samples. Orders for which the
        inputs excite too little are left out, unless that is all of them.
    progress, cancelled : callable, optional
        See `identify`; the stage is `order`. None for no calls.
    feedthrough : bool, optional
        Whether outputs respond within the sample.

    Returns
    -------
    OrderSelection
        The criteria of each order, and the one to take.

    Raises
    ------
    IdentificationError
        If an order is not allowed, the data are too few or determine no model, or the selection is cancelled.
    """
    watch = Watch(progress, cancelled)
    require_kind("data", data, IdentificationData, "IdentificationData", IdentificationError)
    require_kind("feedthrough", feedthrough, (bool, np.bool_), "True or False", IdentificationError)
    if orders is not None:
        orders = whole_numbers("orders", orders, IdentificationError)
    tried = tuple(sorted(set(orders))) if orders is not None else tuple(range(1, HIGHEST + 1))
    if not tried:
        raise IdentificationError("there are no orders to choose from")
    for order in tried:
        check_order(order)
    highest = highest_excited_order(data, tried[-1])
    tried = tuple(order for order in tried if order <= highest) or tried
    steps = OrderProgress(watch, len(tried), _REACH)
    scaled = ScaledData.of([item.inputs for item in data.experiments], [item.outputs for item in data.experiments])
    with small_matrices(f"no order can be chosen from {data.samples} samples"):
        return _compare(scaled, tried if orders is not None else _affordable(scaled, tried), steps, feedthrough)


def _affordable(data: ScaledData, orders: tuple[int, ...]) -> tuple[int, ...]:
    """The orders for which the samples suffice; if there are none, the lowest, whose error shows how many it needs."""
    highest = orders[0]
    for order in orders:
        try:
            horizons(data, order)
        except IdentificationError:
            break
        highest = order
    return tuple(order for order in orders if order <= highest)


def _compare(data: ScaledData, orders: tuple[int, ...], steps: OrderProgress, feedthrough: bool) -> OrderSelection:
    past, future = horizons(data, orders[-1])
    triangle = DataTriangle(data, past, future, feedthrough)
    steps.advance()
    p, q = triangle.p, triangle.q
    regression = PastRegression(triangle, triangle.best_past(shortest_horizon(orders[-1], p)))
    maps = [future_map(regression, float(ridge)) for ridge in _RIDGES]
    steps.advance()
    memory = memory_of(data)
    first, second, first_steps, second_steps = halves(data, memory)
    whole = FiniteMemory.of(first + second, first_steps + second_steps, p, feedthrough)
    training = FiniteMemory.of(first, first_steps, p, feedthrough)
    validation = FiniteMemory.of(second, second_steps, p, feedthrough)
    del first, second
    fits: list[Fit | None] = []
    likelihood, error = np.full(len(orders), np.inf), np.full(len(orders), np.inf)
    for number, order in enumerate(orders):
        steps.advance()
        fit = _fit(regression, maps, whole, order)
        fits.append(fit)
        if fit is None:
            continue
        likelihood[number] = 2.0 * len(data.inputs) * cost_of(fit)
        trained = refine(fit.modes, training)
        if trained is not None:
            spread = float(np.linalg.slogdet(validation.error_covariance(trained))[1])
            error[number] = math.exp(0.5 * spread / p)
    if not np.isfinite(likelihood).any():
        raise IdentificationError(f"the data determine no model of the orders {orders[0]} to {orders[-1]}")
    parameters = np.array(orders, dtype=np.float64) * (p + q)  # of A, B, C, K minus those of the state's coordinates
    if len(data.lengths) <= MOST_EXPERIMENTS:
        search = partial(_on_all_samples, data, feedthrough)
        penalty = math.log(whole.steps) * parameters
        _refine_around_the_best(search, len(data.inputs), fits, orders, likelihood, penalty, steps)
    steps.end()
    aic, bic = likelihood + 2.0 * parameters, likelihood + math.log(whole.steps) * parameters
    strengths = linalg.svdvals(regression.columns @ maps[0])
    return OrderSelection(orders, strengths / strengths[0], aic - aic.min(), bic - bic.min(), error)


def _refine_around_the_best(
    whole: Callable[[Modes, NDArray[np.float64]], Fit],
    samples: int,
    fits: list[Fit | None],
    orders: tuple[int, ...],
    likelihood: NDArray[np.float64],
    penalty: NDArray[np.float64],
    steps: OrderProgress,
) -> None:
    """Enter the likelihood of the `pem` model of all samples for the best order and its neighbours, the best first."""
    refined = np.zeros(len(orders), dtype=bool)
    while True:
        criterion = likelihood + penalty
        best = orders[int(np.argmin(criterion))]
        near = [n for n, order in enumerate(orders) if abs(order - best) <= _REACH and not refined[n]]
        if not near:
            return
        number = min(near, key=criterion.__getitem__)
        least = min(criterion[refined], default=math.inf)
        refined[number] = True
        steps.begin_search(len(near))
        fit = fits[number]
        if fit is None:
            continue
        search = _Search(samples, len(fit.covariance), float(least - penalty[number]))
        try:
            fit = fit_modes(
                fit.modes,
                whole,
                len(fit.covariance),
                steps.advance_search,
                _MOST_ITERATIONS,
                hopeless=search.hopeless,
                first=fit,
            )
        except linalg.LinAlgError:
            continue
        likelihood[number] = min(likelihood[number], 2.0 * samples * cost_of(fit))


def _on_all_samples(data: ScaledData, feedthrough: bool, modes: Modes, weight: NDArray[np.float64]) -> Fit:
    return fit_gains(modes, data.inputs, data.outputs, weight, data.lengths, feedthrough)


@dataclass(frozen=True)
class _Search:
    """The search of one order, and the likelihood that it must reach to become the best.

    Attributes
    ----------
    samples, outputs : int
        Samples of the data, and outputs.
    needed : float
        Minus twice the logarithm of the likelihood at which the order has the best criterion.
    """

    samples: int
    outputs: int
    needed: float

    def hopeless(self, cost: float, promised: float) -> bool:
        """Whether what a step promises, several times, does not suffice."""
        gain = -self.samples * self.outputs * math.log1p(-min(promised, 0.5))
        return 2.0 * self.samples * cost - _HOPE * gain > self.needed


def _fit(regression: PastRegression, maps: list[NDArray[np.float64]], memory: FiniteMemory, order: int) -> Fit | None:
    """The refined fit from the best of the subspace models; None if there is none."""
    best: Fit | None = None
    for future in maps:
        try:
            a, _, c, _, k = predictor_matrices(regression, future, order)
            modes = Modes.of(a - k @ c, c)
            if not modes.radius < LARGEST_RADIUS:
                continue
            fit = memory.best(modes, np.eye(len(c)))
        except (IdentificationError, linalg.LinAlgError):
            continue
        if best is None or cost_of(fit) < cost_of(best):
            best = fit
    return None if best is None else refine(best.modes, memory)

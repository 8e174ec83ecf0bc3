"""Least squares by Gauss-Newton with Levenberg-Marquardt damping; the points need not be vectors.

Sources: J. Nocedal and S. Wright, Numerical Optimization, 2nd ed., Springer, 2006, section 10.3; H. B. Nielsen, Damping
parameter in Marquardt's method, report IMM-REP-1999-05, Technical University of Denmark, 1999.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.linear.numerics import thin_svd

_FIRST_DAMPING = 0.01  # relative to the largest eigenvalue of the scaled Gauss-Newton matrix
_REDUNDANT = 1e-6  # singular value of a direction, relative to the largest, below which it is lost in rounding
LEAST_SCALE = 1e-8  # effect of a parameter, relative to the largest, below which it is not scaled up to equal effect
_TAKEN = 5  # steps taken that together must make progress
_LEAST_DAMPING = 1e-12  # relative likewise; redundant directions need some damping

Point = TypeVar("Point")
Arrays = NDArray[np.float64]


class Damping:
    """Damping of the steps, relative to the largest eigenvalue; it depends on the accuracy of the last predictions."""

    def __init__(self) -> None:
        self.value = _FIRST_DAMPING
        self._growth = 2.0

    def refused(self) -> None:
        """After a step that did not lower the squares: increase the damping, and more each time."""
        self.value, self._growth = self.value * self._growth, 2.0 * self._growth

    def taken(self, kept: float) -> None:
        """After a step that reached this share of its predicted decrease."""
        self.value, self._growth = max(self.value * max(0.1, 1.0 - (2.0 * kept - 1.0) ** 3), _LEAST_DAMPING), 2.0


def of_squares(before: float, after: float) -> float:
    """Relative decrease of a sum of squares."""
    return 1.0 - after / before


@dataclass(frozen=True)
class Search(Generic[Point]):
    """How a search ended.

    Attributes
    ----------
    point : Point
        The point with the least cost.
    iterations : int
        Steps tried, taken or not.
    left : float
        Relative decrease of the squared errors that a further step promises.
    """

    point: Point
    iterations: int
    left: float


def minimise(
    start: Point,
    cost: Callable[[Point], float],
    linearise: Callable[[Point], tuple[Arrays, Arrays]],
    move: Callable[[Point, Arrays], Point | None],
    progress: Callable[[int, float], None] | None = None,
    most_iterations: int = 30,
    least_gain: float = 1e-5,
    least_scale: float = LEAST_SCALE,
    decrease: Callable[[float, float], float] = of_squares,
    hopeless: Callable[[float, float], bool] | None = None,
    least_progress: float = 0.0,
) -> Search[Point]:
    """The point with the least cost that a search from `start` finds, never worse than `start`.

    Parameters
    ----------
    start : Point
        Where to start; its cost must be finite.
    cost : callable
        Sum of squared errors at a point, or what falls with it; infinite where a point is not allowed.
    linearise : callable
        Derivatives, shape (rows, parameters), of what is subtracted to give the errors, and the errors, shape (rows,),
        both in any orthonormal coordinates of the errors.
    move : callable
        The point after a step of shape (parameters,); None where there is no such point.
    progress : callable, optional
        Called as progress(iteration, least cost) at the start, as iteration 0, and after every step tried. If it
        raises an exception, the search ends.
    most_iterations : int
        Steps tried, taken or not.
    least_gain : float
        Relative decrease of the sum of squares, as predicted by the linearisation, at which the search ends. It also
        ends where steps were refused so often that the damping leaves nothing of the next one.
    least_scale : float
        See `damped_step`.
    decrease : callable
        Called as decrease(cost before, cost after) for the relative decrease of the squared errors.
    hopeless : callable, optional
        Called as hopeless(cost, predicted relative decrease of the squared errors) before each step; the search ends
        where it returns True.
    least_progress : float
        Relative decrease of the sum of squares over the last steps taken, five of them, below which the search ends:
        they keep promising what they do not give, as along a limit of what is allowed.
    """
    point, least, damping = start, cost(start), Damping()
    sensitivity, errors = linearise(point)
    step, promised, left = damped_step(sensitivity, errors, damping.value, least_scale)
    iteration, costs = 0, [least]
    if progress is not None:
        progress(iteration, least)
    while iteration < most_iterations and left >= least_gain and promised > 0.0:
        if hopeless is not None and hopeless(least, left):
            break
        iteration += 1
        trial = move(point, step)
        trial_cost = np.inf if trial is None else cost(trial)
        if trial is None or not trial_cost < least:
            damping.refused()
        else:
            damping.taken(decrease(least, trial_cost) / promised)
            point, least = trial, trial_cost
            costs.append(least)
            sensitivity, errors = linearise(point)
        if progress is not None:
            progress(iteration, least)
        step, promised, left = damped_step(sensitivity, errors, damping.value, least_scale)
        if len(costs) > _TAKEN and decrease(costs[-1 - _TAKEN], least) < least_progress:
            break
    return Search(point, iteration, left)


def damped_step(
    sensitivity: Arrays, errors: Arrays, damping: float, least_scale: float = LEAST_SCALE
) -> tuple[Arrays, float, float]:
    """Levenberg-Marquardt step, and its predicted relative decrease of the sum of squares, with and without damping.

    Damping is relative to the largest eigenvalue of the Gauss-Newton matrix of parameters of equal effect. Where no
    parameter has an effect, there is no step and nothing is predicted. A parameter whose effect, relative to the
    largest, is below `least_scale` is not scaled up to equal effect, so that it moves little.
    """
    scale = np.linalg.norm(sensitivity, axis=0)
    scale = np.maximum(scale, least_scale * scale.max() + np.finfo(float).tiny)
    left, singular, right = thin_svd(sensitivity / scale)
    along = left.T @ errors
    level = damping * singular[0] ** 2
    if not level > 0.0:
        return np.zeros(sensitivity.shape[1]), 0.0, 0.0
    step = right.T @ (singular / (singular**2 + level) * along) / scale
    kept = level / (singular**2 + level)  # remaining share of the errors, per direction
    total = max(float(np.sum(errors**2)), np.finfo(float).tiny)
    certain = singular > _REDUNDANT * singular[0]
    return step, float(np.sum((1.0 - kept**2) * along**2)) / total, float(np.sum(along[certain] ** 2)) / total

"""Least squares by Gauss-Newton with Levenberg-Marquardt damping; the points need not be vectors.

Sources: J. Nocedal and S. Wright, Numerical Optimization, 2nd ed., Springer, 2006, section 10.3; H. B. Nielsen, Damping
parameter in Marquardt's method, report IMM-REP-1999-05, Technical University of Denmark, 1999.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.linear.numerics import thin_svd

_FIRST_DAMPING = 0.01  # relative to the largest eigenvalue of the scaled Gauss-Newton matrix
_REDUNDANT = 1e-6  # singular value of a direction, relative to the largest, below which it is lost in rounding
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


def minimise(
    start: Point,
    squares: Callable[[Point], float],
    linearise: Callable[[Point], tuple[Arrays, Arrays]],
    move: Callable[[Point, Arrays], Point | None],
    progress: Callable[[int, float], None] | None = None,
    most_iterations: int = 30,
    least_gain: float = 1e-5,
) -> Point:
    """The point with the least sum of squared errors that a search from `start` finds, never worse than `start`.

    Parameters
    ----------
    start : Point
        Where to start; `squares` must be finite there.
    squares : callable
        Sum of squared errors at a point, infinite where it is not allowed.
    linearise : callable
        Derivatives, shape (rows, parameters), of what is subtracted to give the errors, and the errors, shape (rows,),
        both in any orthonormal coordinates of the errors.
    move : callable
        The point after a step of shape (parameters,); None where there is no such point.
    progress : callable, optional
        Called as progress(iteration, sum of squares) at the start, as iteration 0, and after every step tried. If it
        raises an exception, the search ends.
    most_iterations : int
        Steps tried, taken or not.
    least_gain : float
        Relative decrease of the sum of squares, as predicted by the linearisation, at which the search ends. It also
        ends where steps were refused so often that the damping leaves nothing of the next one.
    """
    point, cost, damping = start, squares(start), Damping()
    sensitivity, errors = linearise(point)
    for iteration in range(most_iterations):
        if progress is not None:
            progress(iteration, cost)
        step, promised, possible = damped_step(sensitivity, errors, damping.value)
        if not possible >= least_gain or not promised > 0.0:
            break
        trial = move(point, step)
        trial_cost = np.inf if trial is None else squares(trial)
        if trial is None or not trial_cost < cost:
            damping.refused()
            continue
        damping.taken((1.0 - trial_cost / cost) / promised)
        point, cost = trial, trial_cost
        sensitivity, errors = linearise(point)
    return point


def damped_step(
    sensitivity: Arrays, errors: Arrays, damping: float, least_scale: float = 1e-8
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

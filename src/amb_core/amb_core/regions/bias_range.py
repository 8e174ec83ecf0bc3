"""How far the bias has moved in all: a drift that is too slow for the tests may go far."""

from __future__ import annotations

import math


class BiasRange:
    """Range of the bias of one axis, of means that a slow oscillation and noise hardly move.

    Parameters
    ----------
    points : int
        Bias points of a mean.
    """

    def __init__(self, points: int) -> None:
        self._points = points
        self.reset()

    def reset(self) -> None:
        """Forget all points: the input, or what the bias follows, is another."""
        self._sum, self._count = 0.0, 0
        self._lowest, self._highest = math.inf, -math.inf

    def add(self, bias: float) -> float:
        """Add a bias point (m); returns the range of the means so far (m), 0 before the second."""
        self._sum += bias
        self._count += 1
        if self._count == self._points:
            mean = self._sum / self._points
            self._lowest, self._highest = min(self._lowest, mean), max(self._highest, mean)
            self._sum, self._count = 0.0, 0
        return max(self._highest - self._lowest, 0.0)

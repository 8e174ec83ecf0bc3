"""Search for the frequency at which a region begins: a bracket is widened step by step, then halved."""

from __future__ import annotations

import math
from collections.abc import Sequence

STEP = 1.1  # first step beyond a frequency that was expected at the boundary; every further step is the square


class BoundarySearch:
    """Finds where a property of a sine begins as its frequency rises, by trials at single frequencies.

    The search takes the property as monotone: between a frequency without it and a higher one with it there is one
    boundary. It finds one boundary if there are several.

    Parameters
    ----------
    guesses : sequence of float
        Frequencies near which the boundary is expected (Hz), tried first; at least one.
    limits : tuple of float
        Lowest and highest frequency that may be tried (Hz).
    resolution : float
        Relative width of the bracket at which the search ends.

    Attributes
    ----------
    low : float
        Highest frequency without the property (Hz), 0 before one is known.
    high : float
        Lowest frequency with the property (Hz), infinity before one is known.
    """

    def __init__(self, guesses: Sequence[float], limits: tuple[float, float], resolution: float) -> None:
        self._limits, self._resolution = limits, resolution
        self._guesses = [self._within(guess) for guess in guesses]
        self._step = STEP
        self.low, self.high = 0.0, math.inf

    @property
    def frequency(self) -> float | None:
        """Frequency of the next trial (Hz); None if the search has ended."""
        for guess in self._guesses:
            if self.low < guess < self.high:
                return guess
        if math.isinf(self.high):
            return None if self.low >= self._limits[1] else self._within(self.low * self._step)
        if self.low == 0.0:
            return None if self.high <= self._limits[0] else self._within(self.high / self._step)
        if self.high <= (1.0 + self._resolution) * self.low:
            return None
        return self._within(math.sqrt(self.low * self.high))

    def add(self, frequency: float, inside: bool) -> None:
        """Add the result of a trial: whether the property holds at a frequency (Hz)."""
        one_sided = self.low == 0.0 or math.isinf(self.high)
        if one_sided and frequency not in self._guesses:
            self._step **= 2
        if inside:
            self.high = min(self.high, frequency)
        else:
            self.low = max(self.low, frequency)

    def _within(self, frequency: float) -> float:
        low, high = self._limits
        # Rounded: equal frequencies are equal in every map, and so are the tasks.
        return min(max(float(f"{frequency:.6g}"), low), high)

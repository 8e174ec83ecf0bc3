"""Past inputs: an onset that is found afterwards gets the input frequency at its step."""

from __future__ import annotations

import math

import numpy as np

from amb_core.regions.state import Onset

CAPACITY = 4096  # updates; the longest trend test looks back 16 times its shortest span, twice


class InputHistory:
    """Input frequency and response per input of every axis, by step, of the latest updates.

    Parameters
    ----------
    sample_time : float
        Controller sample time (s).
    resonance_gain : float
        Response per input at or above which the loop is at its resonance.
    axes : int
        Number of axes.
    """

    def __init__(self, sample_time: float, resonance_gain: float, axes: int) -> None:
        self._sample_time = sample_time
        self._resonance_gain = resonance_gain
        self._steps = np.zeros((axes, CAPACITY))
        self._frequency = np.zeros((axes, CAPACITY))
        self._gain = np.zeros((axes, CAPACITY))
        self._count = 0

    def add(self, steps: list[int], frequency: list[float], gain: list[float]) -> None:
        """Store an update: for every axis the step at which frequency (Hz, NaN if none) and gain hold."""
        if self._count == CAPACITY:
            half = CAPACITY // 2
            for values in (self._steps, self._frequency, self._gain):
                values[:, :half] = values[:, half:].copy()
            self._count = half
        for axis in range(len(steps)):
            self._steps[axis, self._count] = max(steps[axis], self._steps[axis, max(self._count - 1, 0)])
            self._frequency[axis, self._count] = frequency[axis]
            self._gain[axis, self._count] = gain[axis]
        self._count += 1

    def resonant(self, step: int, axis: int) -> bool:
        """Whether the loop responded to its input by more than the resonance gain at a step."""
        if not self._count:
            return False
        at = min(int(np.searchsorted(self._steps[axis, : self._count], step)), self._count - 1)
        return bool(self._gain[axis, at] >= self._resonance_gain)

    def onset(self, step: int, axis: int) -> Onset:
        """An onset at a step, with the frequency interpolated, or extrapolated from the last two updates."""
        known = self._count
        steps, frequency = self._steps[axis, :known], self._frequency[axis, :known]
        value = math.nan
        if known and step <= steps[-1]:
            value = float(np.interp(step, steps, frequency))
        elif known > 1 and steps[-1] > steps[-2]:
            slope = (frequency[-1] - frequency[-2]) / (steps[-1] - steps[-2])
            value = float(frequency[-1] + slope * (step - steps[-1]))
        elif known:
            value = float(frequency[-1])
        return Onset(step, step * self._sample_time, value, self.resonant(step, axis))

"""Compares samples of steps that are in a bag more than once, for example from two controllers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.loop.records import LoopRecord


class RepeatedSamples:
    """The first samples of steps that come more than once: memory is needed for these steps only.

    Parameters
    ----------
    spans : sequence of (int, int)
        First step and step after the last of each span of such steps, ascending and disjoint.
    axes : int
        Number of axes.
    """

    def __init__(self, spans: Sequence[tuple[int, int]], axes: int) -> None:
        self._spans = np.array(spans, dtype=np.int64).reshape(-1, 2)
        lengths = self._spans[:, 1] - self._spans[:, 0]
        self._starts = np.cumsum(lengths) - lengths  # row of the first step of each span
        self._samples = np.empty((int(lengths.sum()), 3 * axes))
        self._known = np.zeros(len(self._samples), dtype=bool)

    def contradict(self, block: LoopRecord) -> bool:
        """Compare a block with the samples that came before, and keep those that are new.

        Parameters
        ----------
        block : LoopRecord
            The block.

        Returns
        -------
        bool
            Whether one of its steps came before with different samples.
        """
        if not len(self._known):
            return False
        rows, repeated = self._rows(block)
        samples = np.hstack([block.reference, block.position, block.current])[repeated]
        known = self._known[rows]
        agrees = np.array_equal(self._samples[rows[known]], samples[known], equal_nan=True)
        self._samples[rows], self._known[rows] = samples, True
        return not agrees

    def _rows(self, block: LoopRecord) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Rows of the steps that come more than once, and which of the block's steps these are."""
        steps = block.first_step + np.arange(block.steps)
        span = np.maximum(np.searchsorted(self._spans[:, 0], steps, side="right") - 1, 0)
        first, stop = self._spans[span].T
        repeated = (first <= steps) & (steps < stop)
        return (self._starts[span] + steps - first)[repeated], repeated

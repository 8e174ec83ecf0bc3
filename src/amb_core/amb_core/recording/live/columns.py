"""Time traces as columns of pixels: the smallest and largest value of the samples behind each column, so peaks stay.

Each level divides time more coarsely than the one before. Samples are taken in block by block, and every level keeps
its last columns only.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Columns:
    """Consecutive columns of one level.

    Attributes
    ----------
    first : int
        Number of the first column, counted from the start or the last `clear`.
    low, high : ndarray, shape (columns, signals)
        Smallest and largest value in each column, in the unit of the samples; NaN where samples are missing.
    """

    first: int
    low: NDArray[np.float64]
    high: NDArray[np.float64]


class ColumnPyramid:
    """Columns of several widths of the same signals.

    Parameters
    ----------
    signals : int
        Number of signals.
    widths : sequence of int
        Samples per column of each level, ascending; each must be a multiple of the one before.
    kept : int
        Columns kept per level.

    Raises
    ------
    ValueError
        If the widths are not such multiples.
    """

    def __init__(self, signals: int, widths: Sequence[int], kept: int) -> None:
        factors = [widths[0], *(wide // narrow for narrow, wide in itertools.pairwise(widths))]
        if widths[0] < 1 or list(np.cumprod(factors)) != list(widths) or min(factors) < 1:
            raise ValueError(f"widths {list(widths)}: allowed are ascending multiples, each of the one before")
        self.widths = tuple(widths)
        self._levels = [_Level(signals, factor, kept) for factor in factors]

    def add(self, samples: NDArray[np.float64]) -> None:
        """Take in consecutive samples, shape (steps, signals).

        Parameters
        ----------
        samples : ndarray, shape (steps, signals)
            Samples, in the unit of each signal; NaN where one is missing.
        """
        low = high = samples
        for level in self._levels:
            low, high = level.add(low, high)
            if not len(low):
                return

    def skip(self, steps: int) -> None:
        """Leave a gap of so many missing samples; one longer than all that is kept is taken as that long.

        A long gap costs no more than a short one: its samples are not made.

        Parameters
        ----------
        steps : int
            Number of missing samples.
        """
        longest = self.widths[-1] * self._levels[-1].kept
        low = high = np.empty((0, self._levels[0].signals))
        missing = min(max(steps, 0), longest)
        for level in self._levels:
            low, high, missing = level.skip(low, high, missing)

    def end(self, level: int) -> int:
        """Number of the next column of a level.

        Parameters
        ----------
        level : int
            Index of the level, from the finest.

        Returns
        -------
        int
            Number of columns so far.
        """
        return self._levels[level].count

    def since(self, level: int, first: int) -> Columns:
        """The kept columns of a level from a number onwards.

        Parameters
        ----------
        level : int
            Index of the level, from the finest.
        first : int
            Number of the first column wanted.

        Returns
        -------
        Columns
            Smallest and largest values of each column.
        """
        return self._levels[level].since(first)


class _Level:
    """Ring of the last columns of one width, made from the columns of the next finer level."""

    def __init__(self, signals: int, factor: int, kept: int) -> None:
        self.signals, self.kept, self.count = signals, kept, 0
        self._factor = factor
        self._low = np.full((kept, signals), np.nan)
        self._high = np.full((kept, signals), np.nan)
        self._rest = (np.empty((0, signals)), np.empty((0, signals)))  # of an unfinished column

    def add(
        self, low: NDArray[np.float64], high: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Take in finer columns; the columns that they complete."""
        low, high = np.concatenate([self._rest[0], low]), np.concatenate([self._rest[1], high])
        whole = len(low) // self._factor * self._factor
        self._rest = (low[whole:], high[whole:])
        if self._factor > 1:
            # fmin and fmax: a column with some samples shows those
            low = np.fmin.reduce(low[:whole].reshape(-1, self._factor, self.signals), axis=1)
            high = np.fmax.reduce(high[:whole].reshape(-1, self._factor, self.signals), axis=1)
        places = np.arange(self.count, self.count + len(low))[-self.kept :] % self.kept
        self._low[places], self._high[places] = low[-self.kept :], high[-self.kept :]
        self.count += len(low)
        return low, high

    def skip(
        self, low: NDArray[np.float64], high: NDArray[np.float64], missing: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Take in finer columns, one at most, and a number of missing ones; the same of this level."""
        filling = min(missing, -(len(self._rest[0]) + len(low)) % self._factor)
        gap = np.full((filling, self.signals), np.nan)
        completed = self.add(np.concatenate([low, gap]), np.concatenate([high, gap]))
        columns, left = divmod(missing - filling, self._factor)
        if left:  # then nothing else is unfinished
            self._rest = (np.full((left, self.signals), np.nan), np.full((left, self.signals), np.nan))
        self.count += columns
        places = np.arange(self.count - min(columns, self.kept), self.count) % self.kept
        self._low[places] = self._high[places] = np.nan
        return *completed, columns

    def since(self, first: int) -> Columns:
        first = max(first, self.count - self.kept, 0)
        places = np.arange(first, max(first, self.count)) % self.kept
        return Columns(first, self._low[places], self._high[places])

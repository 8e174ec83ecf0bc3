"""Least squares over lagged signals of several experiments, on a triangular factor of the data matrix.

Rows never cross the border of an experiment. Time is linear in the samples; the whole data matrix is never in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.dataset import IdentificationData
from amb_core.linear.numerics import with_rows

_BLOCK = 4_000  # rows of the data matrix held at once


def centred(data: IdentificationData) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Inputs and outputs of each experiment without its means; each signal scaled to unit variance over all."""
    inputs = _scaled([item.inputs - item.inputs.mean(axis=0) for item in data.experiments])
    outputs = _scaled([item.outputs - item.outputs.mean(axis=0) for item in data.experiments])
    return list(zip(inputs, outputs, strict=True))


def _scaled(parts: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Signals of unit variance; one that does not move is zero."""
    largest = np.max([np.abs(part).max(axis=0) for part in parts], axis=0)
    parts = [part / np.where(largest > 0.0, largest, 1.0) for part in parts]  # no square over- or underflows
    power = sum(np.sum(part**2, axis=0) for part in parts) / sum(map(len, parts))
    return [part / np.where(power > 0.0, np.sqrt(power), 1.0) for part in parts]


def rows_of(signals: NDArray[np.float64], lags: range) -> NDArray[np.float64]:
    """Rows [z[k - lag] for each lag] of one experiment from sample max(lags) onwards, shape (rows, columns * lags)."""
    first, steps = max(lags), len(signals)
    if steps <= first:
        return np.empty((0, signals.shape[1] * len(lags)))
    return np.hstack([signals[first - lag : steps - lag] for lag in lags])


def pieces(data: IdentificationData, reach: int) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Inputs and outputs as `centred` has them, in pieces whose rows of `reach` lags are those of the experiments."""
    for u, y in centred(data):
        for start in range(0, len(u) - reach, _BLOCK):
            part = slice(start, start + _BLOCK + reach)
            yield u[part], y[part]


def triangle_of(matrices: Iterable[NDArray[np.float64]]) -> tuple[NDArray[np.float64], int]:
    """Triangular factor of one or more matrices on top of one another, and their rows; it has as many as columns."""
    factor, rows = np.empty((0, 0)), 0
    for matrix in matrices:
        columns = matrix.shape[1]
        if not rows:
            factor = np.zeros((columns, columns))
        factor = with_rows(factor, matrix)
        rows += len(matrix)
    return factor, rows

"""Least squares over lagged signals of several experiments, on a triangular factor of the data matrix.

Rows never reach across the border of an experiment. Time and memory are linear in the samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from amb_core.identification.data.dataset import IdentificationData

_BLOCK = 4_000  # rows of the data matrix held at once


def centred(data: IdentificationData) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Inputs and outputs of each experiment without its means; each signal scaled to unit variance over all."""
    inputs = _scaled([item.inputs - item.inputs.mean(axis=0) for item in data.experiments])
    outputs = _scaled([item.outputs - item.outputs.mean(axis=0) for item in data.experiments])
    return list(zip(inputs, outputs, strict=True))


def _scaled(parts: list[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """Signals of unit variance; one that does not move is zero."""
    largest = np.max([np.abs(part).max(axis=0) for part in parts], axis=0)
    parts = [part / np.where(largest > 0.0, largest, 1.0) for part in parts]  # so that no square over- or underflows
    power = sum(np.sum(part**2, axis=0) for part in parts) / sum(map(len, parts))
    return [part / np.where(power > 0.0, np.sqrt(power), 1.0) for part in parts]


def rows_of(signals: NDArray[np.float64], lags: range) -> NDArray[np.float64]:
    """Rows [z[k - lag] for each lag] of one experiment from sample max(lags) on, shape (rows, columns * lags)."""
    first, steps = max(lags), len(signals)
    if steps <= first:
        return np.empty((0, signals.shape[1] * len(lags)))
    return np.hstack([signals[first - lag : steps - lag] for lag in lags])


def triangle_of(matrices: list[NDArray[np.float64]]) -> tuple[NDArray[np.float64], int]:
    """Triangular factor of the matrices on top of one another, with at least as many rows as columns; their rows."""
    columns = matrices[0].shape[1]
    factor = np.zeros((columns, columns))
    for matrix in matrices:
        for start in range(0, len(matrix), _BLOCK):
            stacked = np.vstack([factor, matrix[start : start + _BLOCK]])
            factor = linalg.qr(stacked, mode="r", overwrite_a=True, check_finite=False)[0][:columns]
    return factor, sum(map(len, matrices))

"""Whether data hold samples of the identification again: by their content, whatever the files are called.

The fingerprint of data are the smallest hashes of short stretches of the outputs: of their changes from sample to
sample, rounded to a part of the noise, that of the prediction errors. So a copy with fewer digits, without offsets, or
of a part of the data has the same hashes, while another experiment with the same reference has other noise, and other
hashes. Stretches in which the outputs hardly move hold no noise and do not count: a coarse sensor at rest repeats
itself. The share of the hashes that other data hold again estimates the share of the samples that both have.

Source: A. Z. Broder, On the resemblance and containment of documents, Compression and Complexity of Sequences, 1997.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.data.experiments import IdentificationData, restore

COUNT = 64
"""Hashes of a fingerprint."""
_STRETCH = 32  # changes of all outputs behind one hash
_MOVES = 12  # of them that are not zero, at least
_OF_NOISE = 0.05  # to which changes are rounded
_ROUNDING = 1e-7  # relative to the largest value: that of single precision
_NO_STEP = 2.0**32
_BITS = 52  # of a hash: a double holds it exactly
_FACTORS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9))


def fingerprint_of(data: IdentificationData, noise: ArrayLike) -> NDArray[np.float64]:
    """Fingerprint of the outputs: p steps to which changes are rounded, and 64 hashes or fewer.

    `noise`, shape (p,), is the standard deviation of the prediction errors, in the units of the outputs.
    """
    largest = np.max([np.abs(item.outputs).max(axis=0) for item in restore(data).experiments], axis=0)
    steps = np.maximum(_OF_NOISE * np.asarray(noise, dtype=np.float64), _ROUNDING * largest)
    steps = np.maximum(steps, np.finfo(float).tiny)
    return np.concatenate([steps, np.unique(_hashes(data, steps))[:COUNT]])


def overlap(fingerprint: NDArray[np.float64], data: IdentificationData) -> float:
    """Share of the samples behind a fingerprint that data hold again, about; NaN without a fingerprint."""
    outputs = len(data.output_names)
    steps, hashes = fingerprint[:outputs], fingerprint[outputs:]
    if not len(hashes) or not np.all((steps > 0.0) & (steps < _NO_STEP)):  # of an earlier version: hashes alone
        return math.nan
    return float(np.isin(hashes, _hashes(data, steps)).mean())


def _hashes(data: IdentificationData, steps: NDArray[np.float64]) -> NDArray[np.float64]:
    """A hash of each stretch."""
    hashes = [_of_experiment(np.diff(item.outputs, axis=0) / steps) for item in restore(data).experiments]
    return np.concatenate(hashes)


def _of_experiment(changes: NDArray[np.float64]) -> NDArray[np.float64]:
    count = len(changes) - _STRETCH + 1
    if count < 1:
        return np.empty(0)
    with np.errstate(over="ignore"):
        whole = np.rint(changes).astype(np.int64)
        rows = np.zeros(len(whole), dtype=np.uint64)
        for column in whole.astype(np.uint64).T:
            rows = _mixed(rows ^ column)
        hashes = np.zeros(count, dtype=np.uint64)
        for lag in range(_STRETCH):
            hashes = hashes * _FACTORS[1] + rows[lag : lag + count]
        hashes = _mixed(hashes) >> np.uint64(64 - _BITS)
    moves = np.concatenate([[0], np.cumsum(np.count_nonzero(whole, axis=1))])
    return hashes[moves[_STRETCH:] - moves[:-_STRETCH] >= _MOVES].astype(np.float64)


def _mixed(values: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Values whose every bit depends on all bits of those before."""
    values = values * _FACTORS[0]
    values = (values ^ (values >> np.uint64(29))) * _FACTORS[1]
    return values ^ (values >> np.uint64(32))

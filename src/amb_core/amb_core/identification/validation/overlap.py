"""Whether data hold samples of the identification again: by their content, whatever the files are called.

The fingerprint of data are the smallest hashes of their samples. The share of them that other data hold again
estimates the share of the samples that both have, for parts, joined and reordered data alike.

Source: A. Z. Broder, On the resemblance and containment of documents, Compression and Complexity of Sequences, 1997.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments import IdentificationData, restore

COUNT = 64
"""Hashes of a fingerprint."""
_BITS = 52  # of a hash: a double holds it exactly
_FACTORS = (np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9))


def fingerprint_of(data: IdentificationData) -> NDArray[np.float64]:
    """Fingerprint of the inputs and outputs, shape (64,) or shorter for fewer samples."""
    return np.unique(_hashes(data))[:COUNT]


def overlap(fingerprint: NDArray[np.float64], data: IdentificationData) -> float:
    """Share of the samples behind a fingerprint that data hold again, about; 0 without a fingerprint."""
    if not len(fingerprint):
        return 0.0
    return float(np.isin(fingerprint, _hashes(data)).mean())


def _hashes(data: IdentificationData) -> NDArray[np.float64]:
    """A hash of each sample; in single precision, so that a file of text with fewer digits has the same."""
    rows = np.vstack([np.hstack([item.inputs, item.outputs]) for item in restore(data).experiments])
    bits = np.ascontiguousarray(rows, dtype=np.float32).view(np.uint32).astype(np.uint64)
    found = np.zeros(len(bits), dtype=np.uint64)
    for column in bits.T:
        found = (found ^ column) * _FACTORS[0]
        found = (found ^ (found >> np.uint64(29))) * _FACTORS[1]
        found ^= found >> np.uint64(32)
    return (found >> np.uint64(64 - _BITS)).astype(np.float64)

"""Responses smoothed over neighbouring frequencies: for any broadband reference, with the resolution of a band."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from amb_core.identification.nonparametric.by_references import ByReferences, Signals, from_sums

_FEWEST_LINES = 16  # of a band
_FREE_TERMS = 6.0  # of the noise in a band, from which the deviations are known well enough
_MOST_BANDS = 2_000
_HANN_CORRELATION = 1.0 + 2.0 * ((2.0 / 3.0) ** 2 + (1.0 / 6.0) ** 2)  # of neighbouring lines: fewer are independent


def over_bands(experiments: Sequence[Signals], sample_time: float) -> ByReferences:
    """Responses from sums over neighbouring frequencies of all experiments, in bands of one width."""
    total = sum(len(item.inputs) for item in experiments) * sample_time
    references = experiments[0].references.shape[1]
    lines = max(_FEWEST_LINES, math.ceil(_HANN_CORRELATION * (references + _FREE_TERMS)))
    bands = max(1, int(min(0.5 / sample_time * total / lines, _MOST_BANDS)))
    width = 0.5 / sample_time / bands
    size = experiments[0].all.shape[1]
    sums, terms = np.zeros((bands, size, size), dtype=np.complex128), 0.0
    for signals in (item.all for item in experiments):
        steps = len(signals)
        window = np.hanning(steps + 1)[:-1, np.newaxis]
        centred = signals - (window * signals).sum(axis=0) / window.sum()
        lines = np.fft.rfft(window * centred, axis=0) / np.sqrt(steps)
        edges = np.round(np.arange(bands + 1) * width * steps * sample_time).astype(int)
        edges[0] = 2  # the window spreads the mean over the first lines
        for band, (start, stop) in enumerate(itertools.pairwise(edges)):
            sums[band] += lines[start:stop].T @ lines[start:stop].conj()
        terms += width * steps * sample_time
    terms /= _HANN_CORRELATION
    method = f"smoothed over {width:.3g} Hz, Hann window"
    return from_sums(width * np.linspace(0.5, bands - 0.5, bands), sums, terms, references, method)

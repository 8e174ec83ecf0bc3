"""Signals that take the classifier through all of its compiled kernels, so that a node does not compile while it runs.

numba compiles a function when it is first called. The classifier calls some of its functions only once a bias drifts, a
slow line is found or an input repeats itself: a monitor would stop in the middle of an experiment, for seconds.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import Excitation, Square, Sweep, generate
from amb_core.loop.records import LoopRecord
from amb_core.regions.classification import classify

_RATE = 10_000.0  # Hz; the kernels are the same for all rates
_QUIET, _EXCITED = 1.0, 1.5  # s
_EXCITATIONS = (
    Sweep(amplitude=20e-6, duration=_EXCITED, frequency_start=20.0, frequency_end=3_300.0, axes="both"),
    Square(amplitude=20e-6, duration=_EXCITED, frequency=125.0, axes="both"),
)


def rehearse() -> None:
    """Classify the signals; takes half a second once everything is compiled."""
    for excitation in _EXCITATIONS:
        classify(_record(excitation))


def _record(excitation: Excitation) -> LoopRecord:
    """A loop with a hum, into which an excitation brings a drift of x and a slow oscillation of y."""
    signal = generate(excitation, _RATE).samples
    quiet = round(_QUIET * _RATE)
    reference = np.vstack([np.zeros((quiet, 2)), signal])
    time = np.arange(len(reference)) / _RATE
    since = np.maximum(time - _QUIET - 0.5, 0.0)
    noise = 1e-8 * np.random.default_rng(0).standard_normal(reference.shape)
    hum = 3e-6 * np.sin(2.0 * np.pi * 50.0 * time)
    slow: NDArray[np.float64] = np.column_stack(
        [40e-6 * since, 8e-6 * np.sin(2.0 * np.pi * 25.0 * time) * (since > 0.0)]
    )
    position = 0.9 * reference + noise + hum[:, np.newaxis] + slow
    return LoopRecord(0, 1.0 / _RATE, reference, position, np.zeros_like(reference))

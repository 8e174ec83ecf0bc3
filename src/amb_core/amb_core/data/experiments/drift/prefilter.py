"""A high-pass prefilter without phase for inputs and outputs alike.

The filter subtracts a moving average with the weights of a Hann window. A filter that all signals pass commutes with
the plant: filtered inputs and outputs have the plant's poles and frequency response. Only samples whose average lies
within the experiment are kept, so the filtered samples obey the plant's equations exactly, from a first state of their
own, and no transient of the filter is left. The filter has a double zero at z = 1: constants and ramps vanish, and a
sine of a period of r window lengths keeps the share 0.65 / r^2.

Source: L. Ljung, System Identification, 2nd ed., Prentice Hall, 1999, section 14.4 (prefiltering, drift).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.data.experiments.dataset import IdentificationData, require_data
from amb_core.data.experiments.experiment import Experiment
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import whole_number

CORNER = 1.0
"""Frequency at which the filter passes half the amplitude, times the length of its window."""


def high_pass(data: IdentificationData, length: int) -> IdentificationData:
    """The data less their moving average, without means; each experiment loses `length` - 1 samples.

    The means of the original signals are kept as offsets of the trends, as `detrend` does it: they are the operating
    point.

    Parameters
    ----------
    data : IdentificationData
        Data with finite values.
    length : int
        Samples of the moving average, an odd number of 3 or more.

    Returns
    -------
    IdentificationData
        The filtered data.

    Raises
    ------
    IdentificationError
        If the length is not allowed, or an experiment is not longer.
    """
    require_data(data)
    length = whole_number("length", length, IdentificationError)
    if length < 3 or length % 2 == 0:
        raise IdentificationError(f"a moving average of {length} samples is not allowed; allowed: odd numbers from 3")
    kernel = _kernel(length)
    return replace(
        data, experiments=tuple(_filtered(item, kernel, index) for index, item in enumerate(data.experiments))
    )


def log_gain(length: int) -> float:
    """Mean over all frequencies of the logarithm of the filter's squared gain.

    By so much the filter lowers the mean logarithm of any spectrum, hence that of the innovations' variance of a signal
    (Szego, Kolmogorov), whether or not the signal has drift.
    """
    points = 1 << max(12, math.ceil(math.log2(16 * length)))
    gain = np.abs(np.fft.rfft(_kernel(length)[:, 0], points))[1:]
    return float(2.0 * np.mean(np.log(gain)))


def _kernel(length: int) -> NDArray[np.float64]:
    """Impulse minus the weights of the average, shape (length, 1)."""
    angle = 2.0 * np.pi * np.arange(1, length + 1) / (length + 1)
    weights = 1.0 - np.cos(angle)
    kernel = -weights / weights.sum()
    kernel[length // 2] += 1.0
    return np.asarray(kernel[:, np.newaxis])


def _filtered(item: Experiment, kernel: NDArray[np.float64], index: int) -> Experiment:
    from scipy import signal  # the import takes most of a second; programs that do not need it should not wait for it

    if item.steps <= len(kernel):
        raise IdentificationError(
            f"experiment {index} has {item.steps} samples; a moving average of {len(kernel)} needs more"
        )
    changes: dict[str, Any] = {"first_step": item.first_step + len(kernel) // 2}
    for name in ("input", "output", "reference"):
        field = name if name == "reference" else f"{name}s"
        samples = getattr(item, field)
        if samples is None:
            continue
        mean, trend = samples.mean(axis=0), np.array(getattr(item, f"{name}_trend"))
        trend[0] += mean
        passed = signal.oaconvolve(samples - mean, kernel, mode="valid", axes=0)
        changes |= {field: passed - passed.mean(axis=0), f"{name}_trend": trend}
    return replace(item, **changes)

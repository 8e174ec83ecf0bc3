"""Steady drift of the signals of a periodic experiment.

A drift along a straight line adds the same ramp to every period. A mean over the periods keeps it, at all lines, where
it would pass for a distortion. Only the means of the periods differ by it; distortions leave these alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def without_drift(periods: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signals less the slope of the straight line through the means of their periods.

    The same ramp is taken from every period: the variance from period to period at the lines above 0 Hz, and its
    degrees of freedom, stay as they are. So does the mean over all periods.

    Parameters
    ----------
    periods : ndarray, shape (periods, steps, axes)
        Signals over two consecutive periods or more.

    Returns
    -------
    ndarray, shape (periods, steps, axes)
        The same without drift.
    """
    count, steps, _ = periods.shape
    place = np.arange(count) - 0.5 * (count - 1)
    per_period = np.tensordot(place, periods.mean(axis=1), axes=1) / np.sum(place**2)
    time = (np.arange(count * steps) + 0.5) / steps - 0.5 * count  # in periods, from the middle
    return np.asarray(periods - time.reshape(count, steps, 1) * per_period)

"""Arrays of a message: the type that ROS accepts without a check of each element, and back."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import ArrayLike


def doubles(values: ArrayLike) -> array[float]:
    """Values row by row, for a field `float64[]`."""
    return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())

"""Arrays of a message: the type that ROS takes without a look at each element, and back."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import ArrayLike


def doubles(values: ArrayLike) -> array[float]:
    """Row by row, as a field `float64[]` takes it."""
    return array("d", np.ascontiguousarray(values, dtype=np.float64).tobytes())

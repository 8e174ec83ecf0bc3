"""What every control law of the workbench offers: to the nodes, and to the loop without ROS."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray


class ControlLaw(Protocol):
    """A control law with its state: one call of `update` per controller sample."""

    nominal_reference: NDArray[np.float64]
    """Reference position of each axis without an excitation (m), shape (axes,)."""

    @property
    def axes(self) -> int:
        """Number of axes."""

    @property
    def sample_rate(self) -> float:
        """Sample rate for which it is made (Hz)."""

    def reset(self) -> None:
        """Forget the past: the next sample is the first."""

    def update(self, position: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
        """Control current references (A), shape (axes,), for a measured and a reference position (m) of each axis."""

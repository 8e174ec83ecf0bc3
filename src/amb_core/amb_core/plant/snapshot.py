"""The internal state of the plant at the end of a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.axial import AxialSnapshot


@dataclass(frozen=True)
class PlantSnapshot:
    """Internal state of the plant at the end of a sample; the first index of all arrays is the bearing, A then B.

    Attributes
    ----------
    coil_current : ndarray, shape (bearings, 4)
        Coil currents of electromagnets +x, +y, -x, -y (A).
    flux_density : ndarray, shape (bearings, 8)
        In the air gaps of the poles, positive from stator to journal (T).
    force, contact_force : ndarray, shape (bearings, 2)
        Magnetic force, and force of the backup bearing, on the journal (N).
    position : ndarray, shape (bearings, 2)
        Of the journal (m).
    contact : ndarray of bool, shape (bearings,)
        Whether the backup bearing pushed the journal or the journal has reached it.
    axial : AxialSnapshot or None
        The same of the thrust bearing. None without one.
    """

    coil_current: NDArray[np.float64]
    flux_density: NDArray[np.float64]
    force: NDArray[np.float64]
    contact_force: NDArray[np.float64]
    position: NDArray[np.float64]
    contact: NDArray[np.bool_]
    axial: AxialSnapshot | None = None

"""Region D of one bearing: the rotor at its backup bearing."""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from amb_core.regions.state import Onset


class Contact:
    """Largest displacement in a bearing since the last update, and whether the rotor has touched it.

    Parameters
    ----------
    name : str
        Of the bearing.
    columns : list of int
        Its axes, as columns of arrays of samples.
    clearance : float
        Displacement from the centre at which the rotor touches it (m).

    Attributes
    ----------
    radius : float
        Largest displacement since the last update (m): radial, or along the shaft in a thrust bearing.
    since : Onset or None
        Where region D begins; None while there is none.
    """

    def __init__(self, name: str, columns: list[int], clearance: float) -> None:
        self.name = name
        self.columns = columns
        self.clearance = clearance
        self.radius = 0.0
        self.since: Onset | None = None
        self._clear = 0  # updates without contact

    def displacement(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distance from the centre (m), shape (steps,), of the positions of all axes (m), shape (steps, axes)."""
        distance: NDArray[np.float64] = reduce(np.hypot, (np.abs(position[:, column]) for column in self.columns))
        return distance

    def note(self, displacement: NDArray[np.float64]) -> None:
        """Take in displacements (m), shape (steps,)."""
        self.radius = max(self.radius, float(displacement.max()))

    def touched(self, displacement: NDArray[np.float64]) -> int | None:
        """First row of displacements (m) at which the rotor touches a bearing that it had not touched; else None."""
        beyond = displacement >= self.clearance
        return int(np.argmax(beyond)) if self.since is None and beyond.any() else None

    def begin(self, onset: Onset) -> None:
        """Region D begins."""
        self.since, self._clear = onset, 0

    def count_clear(self) -> int:
        """Updates in a row without contact, that of the present interval included."""
        self._clear = 0 if self.radius >= self.clearance else self._clear + 1
        return self._clear

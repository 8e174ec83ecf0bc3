"""What the model of a machine lets expect of its rig: gains and currents at rest, resonances, unstable poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, linearize


@dataclass(frozen=True, eq=False)
class Expected:
    """Of the linearised machine in the loop of its controller.

    Attributes
    ----------
    gain : ndarray, shape (axes, axes)
        Change of the position at rest (row) over that of the reference (column).
    current : ndarray, shape (axes,)
        Control currents at rest (A).
    unstable_poles : int
        Of the plant alone.
    """

    gain: NDArray[np.float64]
    current: NDArray[np.float64]
    unstable_poles: int
    loop: LinearSystem

    def response(self, frequency: NDArray[np.float64], axis: int) -> NDArray[np.complex128]:
        """From reference to position of an axis at some frequencies (Hz), shape (frequencies,)."""
        return self.loop.response(frequency)[:, axis, axis]


def expected_of(plant: PlantParameters, controller: ControllerParameters) -> Expected:
    """What to expect of a machine with a PD controller.

    Raises
    ------
    PlantError
        If the controller cannot hold the rotor.
    """
    found = linearize(Plant(plant), controller.at_rate(plant.integration.sample_rate))
    current = found.point.current_reference
    if found.axial_point is not None:
        current = np.append(current, found.axial_point.current_reference)
    loop = found.closed_loop
    unstable = int(np.sum(np.abs(found.discrete.poles()) > 1.0))
    return Expected(np.real(loop.response([0.0])[0]), current, unstable, loop)

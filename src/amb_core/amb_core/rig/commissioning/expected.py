"""What the model of a machine predicts of its rig: gains and currents at rest, resonances, unstable poles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters
from amb_core.plant import Plant, PlantParameters, linearize
from amb_core.plant.network import COIL_AXES
from amb_core.plant.operating_point import static_force
from amb_core.plant.rotor import journal_loads


@dataclass(frozen=True, eq=False)
class Expected:
    """Of the linearised machine in the loop of its controller.

    Attributes
    ----------
    gain : ndarray, shape (axes, axes)
        Change of the position at rest (row) over that of the reference (column) (-).
    current : ndarray, shape (axes,)
        Control currents at rest (A).
    unstable_poles : int
        Of the plant alone.
    loop : LinearSystem
        From references to positions (m).
    plant : LinearSystem
        From control currents (A) to positions (m), as sampled.
    resting : ndarray, shape (axes,)
        Force per control current where the rotor lies on its backup bearing, over that in the centre (-).
    """

    gain: NDArray[np.float64]
    current: NDArray[np.float64]
    unstable_poles: int
    loop: LinearSystem
    plant: LinearSystem
    resting: NDArray[np.float64]

    @property
    def fastest(self) -> float:
        """Fastest unstable pole of the plant as a rate (1/s); 0 without one."""
        poles = np.abs(self.plant.poles())
        return float(np.log(max(poles.max(), 1.0)) / self.plant.sample_time)

    def response(self, frequency: NDArray[np.float64], axis: int) -> NDArray[np.complex128]:
        """From reference to position of an axis at some frequencies (Hz), shape (frequencies,).

        Parameters
        ----------
        frequency : ndarray, shape (frequencies,)
            Frequencies (Hz).
        axis : int
            Index of the axis.

        Returns
        -------
        ndarray of complex, shape (frequencies,)
            Position over reference (-).
        """
        return self.loop.response(frequency)[:, axis, axis]


def expected_of(plant: PlantParameters, controller: ControllerParameters) -> Expected:
    """What to expect of a machine with a PD controller.

    Parameters
    ----------
    plant : PlantParameters
        Parameters of the machine.
    controller : ControllerParameters
        Parameters of its controller, of any sample rate.

    Returns
    -------
    Expected
        Gains, currents and responses of the linearised loop.

    Raises
    ------
    PlantError
        If the controller cannot hold the rotor.
    """
    linear = linearize(Plant(plant), controller.at_rate(plant.integration.sample_rate))
    current = linear.point.current_reference
    if linear.axial_point is not None:
        current = np.append(current, linear.axial_point.current_reference)
    loop = linear.closed_loop
    unstable = int(np.sum(np.abs(linear.discrete.poles()) > 1.0))
    return Expected(np.real(loop.response([0.0])[0]), current, unstable, loop, linear.discrete, _resting(Plant(plant)))


def _resting(plant: Plant) -> NDArray[np.float64]:
    """Of each axis: the magnet that the rotor lies nearer to pulls more."""
    radius = plant.parameters.rotor.backup_bearing_radius
    step = 1e-3 * plant.parameters.amplifier.bias_current
    factors = np.ones(len(plant.machine.axes))
    for bearing, load in enumerate(journal_loads(plant.parameters, plant.rotor).reshape(-1, 2)):
        place = radius * load / (np.hypot(*load) or 1.0)
        for column, axis in enumerate("xy".index(name) for name in plant.axes):
            change = COIL_AXES[:, axis] * step * (plant.bias_currents() > 0.0)
            there, centred = (
                static_force(plant, plant.bias_currents() + change, at)[axis]
                - static_force(plant, plant.bias_currents() - change, at)[axis]
                for at in (place, np.zeros(2))
            )
            if centred:
                factors[len(plant.axes) * bearing + column] = there / centred
    return factors

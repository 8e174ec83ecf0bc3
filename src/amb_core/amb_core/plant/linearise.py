"""Linear models of the plant about an operating point, alone and in the loop of a controller.

The averaged plant (`amb_core.plant.averaged`) is differentiated (`amb_core.plant.differences`): the continuous model.
The discrete model holds the control currents over each sample, the computation delay included. With pulse-width
modulation resolved it has the sampling of the modulation too (`amb_core.plant.sampled_amplifiers`), which makes the
coil currents lag less; with the modulation averaged, or where a sample does not hold whole switching periods, it is
exact for the continuous model.

Inputs and outputs are the axes of the machine: i_x, i_y and x, y of one bearing; i_x_a to i_y_b and x_a to y_b of a
rotor in two, then i_z and z of a thrust bearing. A bearing with 1 DOF has i_y and y alone.

Sources: Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 8 (linear bearing, negative stiffness);
ISO 14839-3 (peak sensitivity of the closed loop as a measure of its stability margin).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.given_values import numbers, require_kind
from amb_core.ground.parameters import given_set
from amb_core.linear import LinearSystem
from amb_core.linear.connections import beside, feedback
from amb_core.linear.peak import h_infinity_norm
from amb_core.linear.sampling import discretised
from amb_core.loop.control import ControllerParameters, require_one_rate
from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.linear_control import linear_law
from amb_core.plant.differences import linear_plant
from amb_core.plant.linear_axial import AxialPoint, averaged_axial, axial_point, sampled_axial
from amb_core.plant.operating_point import OperatingPoint, point_at, point_held_by
from amb_core.plant.plant import Plant
from amb_core.plant.rigid_mode import rigid_pair
from amb_core.plant.sampled_amplifiers import modulation_is_regular, sampled_plant

if TYPE_CHECKING:
    from amb_core.linear.step_response import SecondOrder


@dataclass(frozen=True)
class Linearization:
    """Linear models about an operating point; all signals are deviations from it.

    Attributes
    ----------
    point : OperatingPoint
        Point of linearisation of the radial axes.
    axial_point : AxialPoint or None
        That along the rotor's axis; None without a thrust bearing.
    controller : ControllerParameters
        The controller of the loop.
    continuous : LinearSystem
        The averaged plant from i_x, i_y (A) to x, y (m), without the computation delay.
    discrete : LinearSystem
        The plant at the sample rate, the inputs held over each sample, with the sampling of the modulation.
    closed_loop : LinearSystem
        From the reference positions r_x, r_y to the positions x, y (m), discrete.
    sensitivity : LinearSystem
        From a disturbance of the measured positions to the measured positions (m), discrete.
    """

    point: OperatingPoint
    axial_point: AxialPoint | None
    controller: ControllerParameters
    continuous: LinearSystem
    discrete: LinearSystem
    closed_loop: LinearSystem
    sensitivity: LinearSystem

    @property
    def stable(self) -> bool:
        """Whether all poles of the closed loop are inside the unit circle."""
        return bool(self.closed_loop.radius < 1.0)

    @cached_property
    def peak_sensitivity(self) -> float:
        """Largest singular value of the sensitivity (-) over all frequencies; infinite if not `stable`."""
        return h_infinity_norm(self.sensitivity)

    def rigid_mode(self, axis: str) -> SecondOrder | None:
        """Natural frequency and damping ratio of the rigid rotor in the loop along `x` or `y`.

        From its pair of poles: two complex ones, or two real ones of a loop with a damping ratio of one or more. None
        if the rotor has no such pair, because one of its poles has met one of the amplifiers or is unstable.

        Parameters
        ----------
        axis : str
            Name of the axis.

        Returns
        -------
        SecondOrder or None
            Natural frequency and damping ratio.
        """
        from amb_core.linear.step_response import SecondOrder

        if axis not in self.closed_loop.output_names:
            return None
        pair = rigid_pair(self.closed_loop, axis)
        if pair is None:
            return None
        natural = np.sqrt(np.prod(pair).real)
        return SecondOrder(float(natural / (2.0 * np.pi)), float(-pair.sum().real / (2.0 * natural)))


def linearize(
    plant: Plant,
    controller: ControllerParameters | None = None,
    position: NDArray[np.float64] | None = None,
) -> Linearization:
    """Linearise the plant and close the loop.

    Parameters
    ----------
    plant : Plant
        Gives the parameters; its state is neither used nor changed.
    controller : ControllerParameters, optional
        By default the paper's.
    position : ndarray, shape (2,), optional
        Radial rotor position about which to linearise (m). By default the position at which the controller holds the
        rotor, sag included; along its axis it is always that one.

    Returns
    -------
    Linearization
        Operating point, plant and closed loop.

    Raises
    ------
    PlantError
        If there is no such equilibrium within the limits of currents and duty cycles.
    ParameterError
        If the sample rates of plant and controller differ.
    """
    require_kind("plant", plant, Plant, "a Plant, such as Plant(parameters)", PlantError)
    controller = given_set(ControllerParameters, "controller", controller)
    if position is not None:
        position = numbers("position", position, PlantError)
        if position.shape != (2,):
            raise PlantError(f"position of shape {position.shape} is not allowed; allowed: (2,), x and y in m")
    require_one_rate(controller.sample_rate, 1.0 / plant.sample_time)
    point = point_held_by(controller, plant) if position is None else point_at(position, plant)
    along_axis = axial_point(controller, plant)
    continuous = linear_plant(plant, point)
    regular = modulation_is_regular(plant.parameters)
    delay = plant.parameters.converters.computation_delay * plant.sample_time
    discrete = sampled_plant(plant, point) if regular else discretised(continuous, plant.sample_time, delay)
    if plant.axial is not None and along_axis is not None:
        axial = averaged_axial(plant, plant.axial, along_axis)
        sampled = (
            sampled_axial(plant, plant.axial, along_axis) if regular else discretised(axial, plant.sample_time, delay)
        )
        continuous, discrete = beside(continuous, axial), beside(discrete, sampled)
    return Linearization(point, along_axis, controller, continuous, discrete, *close_loop(discrete, controller))


def close_loop(plant: LinearSystem, controller: KnownController) -> tuple[LinearSystem, LinearSystem]:
    """Loop of a discrete plant and a controller without its limits.

    Its states are those of the plant and of the controller; the PD law has one per axis, see `pd_as_linear`.

    Parameters
    ----------
    plant : LinearSystem
        From control currents (A) to positions (m), without direct feed-through.
    controller : KnownController
        The PD law or a linear one.

    Returns
    -------
    closed_loop : LinearSystem
        From reference positions r_x, r_y to x, y (m).
    sensitivity : LinearSystem
        From a disturbance w_x, w_y of the measurement to the measured x, y (m).
    """
    axes, labels = plant.inputs, plant.output_names
    law = linear_law(controller, axes)
    is_pd = not isinstance(controller, LinearControl)
    states = [f"derivative_{label}" for label in labels] if is_pd else [f"controller_{n}" for n in range(law.order)]
    loop = feedback(plant, law.named([f"r_{label}" for label in labels], states=states), references=axes)
    positions = slice(axes, None)
    return loop.part(positions, slice(axes)), loop.part(positions, slice(2 * axes, None))

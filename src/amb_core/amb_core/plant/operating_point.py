"""Equilibria of the plant: where the magnetic force carries the weight of the rotor and nothing changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.control import ControllerParameters
from amb_core.errors import PlantError
from amb_core.plant.averaged import FLUX, INTEGRAL, POSITION, STATE_SIZE, coil_references, magnetic_force
from amb_core.plant.plant import Plant

_TOLERANCE = 1e-9
"""Force left over at an equilibrium, in parts of the weight."""


@dataclass(frozen=True)
class OperatingPoint:
    """An equilibrium of the averaged plant.

    Attributes
    ----------
    state : ndarray, shape (16,)
        State as in `amb_core.plant.averaged`.
    current_reference : ndarray, shape (2,)
        Control current references i_x, i_y that hold it (A).
    """

    state: NDArray[np.float64]
    current_reference: NDArray[np.float64]

    @property
    def position(self) -> NDArray[np.float64]:
        """Rotor position x, y (m), shape (2,)."""
        return self.state[POSITION]


def point_held_by(controller: ControllerParameters, plant: Plant) -> OperatingPoint:
    """Where the controller at rest holds the rotor: below its nominal reference by the sag, as it does not integrate.

    Raises
    ------
    PlantError
        If the rotor finds no equilibrium inside the backup bearing, or takes more current or voltage than there is.
    """
    reference = np.array([controller.nominal_reference_x, controller.nominal_reference_y])

    def held(position: NDArray[np.float64]) -> OperatingPoint:
        return _at_rest(plant, position, controller.proportional_gain * (reference - position))

    gap = plant.parameters.magnetic_circuit.air_gap
    position = gap * _solve(lambda scaled: _unbalanced(held(gap * scaled), plant), reference / gap)
    radius = plant.parameters.rotor.backup_bearing_radius
    if not np.hypot(*position) < radius:  # also when there is no solution, which is NaN
        raise PlantError(
            f"the controller with K_P = {controller.proportional_gain:g} A/m holds the rotor of "
            f"{plant.parameters.rotor.mass:g} kg nowhere inside the backup bearing, {radius:g} m"
        )
    point = held(position)
    largest = np.abs(point.current_reference).max()
    if largest >= controller.current_limit:
        raise PlantError(
            f"holding the rotor takes a control current of {largest:.3g} A; allowed: less than the controller's limit, "
            f"{controller.current_limit:g} A"
        )
    _check_duties(point, plant)
    return point


def point_at(position: NDArray[np.float64], plant: Plant) -> OperatingPoint:
    """The equilibrium at a given rotor position (m), shape (2,), whatever control currents that takes.

    Raises
    ------
    PlantError
        If the position is outside the backup bearing, or no current within the amplifiers' limit holds the rotor.
    """
    position = np.asarray(position, dtype=np.float64)
    radius = plant.parameters.rotor.backup_bearing_radius
    if not np.hypot(*position) < radius:
        raise PlantError(
            f"position {position[0]:g} m, {position[1]:g} m is not inside the backup bearing; allowed: less than "
            f"{radius:g} m from the centre"
        )
    current = _solve(lambda current: _unbalanced(_at_rest(plant, position, current), plant), np.zeros(2))
    if not np.isfinite(current).all():
        raise PlantError(
            f"no control current holds the rotor at {position[0]:g} m, {position[1]:g} m within the amplifiers' limit "
            f"of {plant.parameters.amplifier.current_limit:g} A"
        )
    point = _at_rest(plant, position, current)
    _check_duties(point, plant)
    return point


def static_force(
    plant: Plant, coil_currents: NDArray[np.float64], position: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Magnetic force (N), shape (2,), of constant coil currents (A), shape (4,), on a rotor held at a position (m)."""
    return magnetic_force(plant.static_flux(coil_currents, *position), plant)


def _at_rest(plant: Plant, position: NDArray[np.float64], current_reference: NDArray[np.float64]) -> OperatingPoint:
    """The amplifiers and fluxes at rest around a rotor that is held in place."""
    amplifier, resistance = plant.parameters.amplifier, plant.parameters.magnetic_circuit.coil_resistance
    current = coil_references(current_reference, plant)
    state = np.zeros(STATE_SIZE)
    if amplifier.integral_gain > 0.0:
        state[INTEGRAL] = resistance * current / (2.0 * amplifier.supply_voltage)
    else:  # then an error is left, which makes the voltage that the resistance takes
        gain = 2.0 * amplifier.supply_voltage * amplifier.proportional_gain
        current = current * gain / (gain + resistance) if gain > 0.0 else 0.0 * current
    state[FLUX] = plant.static_flux(current, *position)
    state[POSITION] = position
    return OperatingPoint(state, current_reference)


def _check_duties(point: OperatingPoint, plant: Plant) -> None:
    amplifier, resistance = plant.parameters.amplifier, plant.parameters.magnetic_circuit.coil_resistance
    largest = coil_references(point.current_reference, plant).max()
    duty = 0.5 + resistance * largest / (2.0 * amplifier.supply_voltage)
    if duty >= amplifier.maximum_duty:
        raise PlantError(
            f"holding the rotor takes {largest:.3g} A through {resistance:g} ohm, a duty cycle of {duty:.3g}; allowed: "
            f"less than {amplifier.maximum_duty:g}"
        )


def _unbalanced(point: OperatingPoint, plant: Plant) -> NDArray[np.float64]:
    """Force on the rotor that nothing balances, over its weight (or its weight at 1 m/s^2)."""
    rotor = plant.parameters.rotor
    force = magnetic_force(point.state[FLUX], plant) - np.array([0.0, rotor.mass * rotor.gravity])
    return force / (rotor.mass * max(rotor.gravity, 1.0))


def _solve(
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Root of two functions of two variables, NaN if none is found."""
    from scipy.optimize import root  # takes a third of a second to import

    found = root(residual, start, tol=1e-12)
    # Judged by the residual: at a root of zero the solver's own, relative measure of success cannot be met.
    return found.x if np.abs(found.fun).max() < _TOLERANCE else np.full(2, np.nan)

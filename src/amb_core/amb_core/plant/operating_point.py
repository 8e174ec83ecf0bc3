"""Equilibria of the plant: states at rest in which the magnetic force carries weight and constant external force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant.averaged import AveragedPlant, coil_references
from amb_core.plant.plant import Plant
from amb_core.plant.rotor import rotor_mass

_TOLERANCE = 1e-9
"""Residual force allowed at an equilibrium, relative to the weight or the external force."""


@dataclass(frozen=True)
class OperatingPoint:
    """An equilibrium of the averaged plant.

    Attributes
    ----------
    state : ndarray, shape (n,)
        State as in `amb_core.plant.averaged`.
    current_reference : ndarray, shape (2 * bearings,)
        Control current references i_x, i_y of each bearing that hold it (A).
    journals : ndarray, shape (2 * bearings,)
        Positions of the journals x, y in each bearing (m).
    """

    state: NDArray[np.float64]
    current_reference: NDArray[np.float64]
    journals: NDArray[np.float64]

    @property
    def position(self) -> NDArray[np.float64]:
        """Rotor position x, y in bearing A (m), shape (2,)."""
        return self.journals[:2]


def point_held_by(controller: ControllerParameters, plant: Plant) -> OperatingPoint:
    """Equilibrium with the controller: below the nominal reference by the sag, since there is no integral action.

    Raises
    ------
    PlantError
        If there is no equilibrium inside the backup bearing, or it needs more current or voltage than available.
    """
    averaged = AveragedPlant(plant)
    axes, radial = len(plant.machine.axes), 2 * plant.bearings
    reference, gains = controller.references(axes)[:radial], pack_gains(controller, axes)[:radial, 0]
    sensors = averaged.sensors()[:, averaged.coordinates]
    start = _coordinates(plant, reference)
    # Coordinates in units in which a gap's displacement of a journal is about one
    scale = plant.parameters.magnetic_circuit.air_gap / max(float(np.abs(_journal_shapes(plant)).max()), 1e-12)

    def held(scaled: NDArray[np.float64]) -> OperatingPoint:
        coordinates = scale * scaled
        return _at_rest(averaged, coordinates, gains * (reference - sensors @ coordinates))

    radius = plant.parameters.rotor.backup_bearing_radius
    point = None
    for first in (start, np.zeros_like(start)):  # a soft rotor is found from the centre only
        scaled = _solve(lambda scaled: _unbalanced(held(scaled), averaged), first / scale)
        point = held(scaled) if np.isfinite(scaled).all() else None
        if point is not None and _inside(point, radius):
            break
    if point is None or not _inside(point, radius):
        raise PlantError(
            f"the controller with K_P = {controller.proportional_gain:g} A/m cannot hold the rotor of "
            f"{rotor_mass(plant.parameters, plant.rotor):g} kg inside the backup bearing, {radius:g} m{_pushed(plant)}"
        )
    largest = float(np.abs(point.current_reference).max())
    if largest >= controller.current_limit:
        raise PlantError(
            f"holding the rotor needs a control current of {largest:.3g} A; allowed: less than the controller's "
            f"limit, {controller.current_limit:g} A"
        )
    _check_duties(point, plant)
    return point


def point_at(position: NDArray[np.float64], plant: Plant) -> OperatingPoint:
    """The equilibrium with all journals at a position (m), shape (2,), with the control currents that it needs.

    Raises
    ------
    PlantError
        If the position is outside the backup bearing, or no current within the amplifiers' limit holds the rotor.
    """
    averaged = AveragedPlant(plant)
    position = np.asarray(position, dtype=np.float64)
    radius = plant.parameters.rotor.backup_bearing_radius
    if not np.hypot(*position) < radius:
        raise PlantError(
            f"position {position[0]:g} m, {position[1]:g} m is not inside the backup bearing; allowed: less than "
            f"{radius:g} m from the centre"
        )
    # A flexible rotor sags between its bearings: its coordinates are unknowns as well as the currents.
    journals = np.tile(position, plant.bearings)
    start = _coordinates(plant, journals)
    shapes = _journal_shapes(plant)
    scale = plant.parameters.magnetic_circuit.air_gap / max(float(np.abs(shapes).max()), 1e-12)
    size = len(start)

    def held(unknown: NDArray[np.float64]) -> OperatingPoint:
        return _at_rest(averaged, start + scale * unknown[:size], unknown[size:])

    def residual(unknown: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = scale * (shapes @ unknown[:size]) / 1e-3
        if "x" not in plant.axes:
            moved[0] += unknown[size]  # i_x has no effect, so it is set to zero
        return np.concatenate([_unbalanced(held(unknown), averaged), moved])

    unknown = _solve(residual, np.zeros(size + 2 * plant.bearings))
    if not np.isfinite(unknown).all():
        raise PlantError(
            f"no control current holds the rotor at {position[0]:g} m, {position[1]:g} m within the amplifiers' limit "
            f"of {plant.parameters.amplifier.current_limit:g} A{_pushed(plant)}"
        )
    point = held(unknown)
    _check_duties(point, plant)
    return point


def static_force(
    plant: Plant, coil_currents: NDArray[np.float64], position: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Magnetic force (N), shape (2,), of constant coil currents (A), shape (4,), on a journal held in place (m)."""
    return plant.magnetostatics.force(plant.magnetostatics.solve(coil_currents, *position).flux)


def _coordinates(plant: Plant, journals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coordinates with the journals near these positions (m)."""
    return journals if plant.rotor is None else plant.rotor.coordinates_at(journals[0], journals[1])


def _journal_shapes(plant: Plant) -> NDArray[np.float64]:
    return np.eye(2) if plant.rotor is None else plant.rotor.bearings


def _inside(point: OperatingPoint, radius: float) -> bool:
    return bool((np.hypot(*point.journals.reshape(-1, 2).T) < radius).all())


def _at_rest(
    averaged: AveragedPlant, coordinates: NDArray[np.float64], current_reference: NDArray[np.float64]
) -> OperatingPoint:
    state = averaged.at_rest(coordinates, current_reference)
    return OperatingPoint(state, current_reference, averaged.journals(state))


def _check_duties(point: OperatingPoint, plant: Plant) -> None:
    amplifier, resistance = plant.parameters.amplifier, plant.parameters.magnetic_circuit.coil_resistance
    if not amplifier.limits:
        return
    largest = max(coil_references(pair, plant).max() for pair in point.current_reference.reshape(-1, 2))
    duty = 0.5 + resistance * largest / (2.0 * amplifier.supply_voltage)
    if duty >= amplifier.maximum_duty:
        raise PlantError(
            f"holding the rotor takes {largest:.3g} A through {resistance:g} ohm, a duty cycle of {duty:.3g}; allowed: "
            f"less than {amplifier.maximum_duty:g}"
        )


def _pushed(plant: Plant) -> str:
    """What a refusal says of a constant external force; nothing without one."""
    x, y, _ = plant.parameters.rotor.constant_force
    return f", against an external force of {x:g} N, {y:g} N" if x or y else ""


def _unbalanced(point: OperatingPoint, averaged: AveragedPlant) -> NDArray[np.float64]:
    """Unbalanced force over weight (at least at 1 m/s^2) or external force; the position where nothing can move."""
    plant, rotor = averaged.plant, averaged.plant.parameters.rotor
    weight = rotor_mass(plant.parameters, plant.rotor) * max(rotor.gravity, 1.0)
    left = averaged.unbalanced(point.state) / max(weight, *map(abs, rotor.constant_force[:2]))
    if "x" not in plant.axes:
        left[0] = (point.journals[0] - plant.parameters.rotor.initial_x) / plant.parameters.magnetic_circuit.air_gap
    return left


def _solve(
    residual: Callable[[NDArray[np.float64]], NDArray[np.float64]], start: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Root of as many functions as variables, NaN if none is found."""
    from scipy.optimize import root  # takes a third of a second to import

    solution = root(residual, start, tol=1e-12)
    # The residual decides: at a root of zero the solver's own relative criterion of success cannot be met.
    return solution.x if np.abs(solution.fun).max() < _TOLERANCE else np.full(len(start), np.nan)

"""Modal data of a uniform round shaft, in closed form: a flexible rotor without a finite element program.

    from amb_core.plant import uniform_shaft

    uniform_shaft(length=0.5, diameter=0.064, bearings=(-0.15, 0.15)).save("shaft.npz")

Bending is that of a slender beam with free ends (Euler and Bernoulli: no shear, no rotary inertia). Its frequencies are
somewhat too high if the shaft is not slender. The tilt also neglects the rotary inertia of the cross-sections.

Source: Blevins, "Formulas for Natural Frequency and Mode Shape", Van Nostrand Reinhold 1979, table 8-1, free-free beam.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.ground.given_values import number, numbers, whole_number
from amb_core.plant.modal_data import ModalData

MOST_BENDING_MODES = 8
"""For more modes, cancellation in the hyperbolic functions of the shape leaves less than six digits."""
_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Planes x and y as a gyroscopic matrix connects them."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(80)


def uniform_shaft(
    length: float,
    diameter: float,
    bearings: Sequence[float],
    sensors: Sequence[float] | None = None,
    *,
    bending_modes: int = 3,
    damping_ratio: float = 0.005,
    density: float = 7850.0,
    elastic_modulus: float = 2.1e11,
) -> ModalData:
    """Rigid body modes and lowest bending modes of a uniform round shaft, free and at standstill.

    Modes come in pairs, one along x and one along y: translation, tilt about the middle, then bending. The unbalance is
    in the middle.

    Parameters
    ----------
    length, diameter : float
        Of the shaft (m).
    bearings : sequence of two float
        Axial positions of bearings A and B from the middle of the shaft, A at smaller z (m).
    sensors : sequence of two float, optional
        Those of their sensors (m); by default in the bearings.
    bending_modes : int, optional
        Number of bending modes in each plane, 0 to 8.
    damping_ratio : float, optional
        Damping ratio of the bending modes (-).
    density, elastic_modulus : float, optional
        Of the material (kg/m^3, Pa); by default those of steel.

    Returns
    -------
    ModalData
        Modes, weights and places of the rotor.

    Raises
    ------
    PlantError
        If a dimension is not positive, a position is not on the shaft, or the number of modes is out of its range.
    """
    sensors = bearings if sensors is None else sensors
    _check_positive(length=length, diameter=diameter, density=density, elastic_modulus=elastic_modulus)
    _check_places(length, bearings=bearings, sensors=sensors)
    bending_modes = whole_number("bending_modes", bending_modes, PlantError)
    if not 0 <= bending_modes <= MOST_BENDING_MODES:
        raise PlantError(f"uniform shaft: bending_modes = {bending_modes}; allowed: 0 to {MOST_BENDING_MODES}")

    area = 0.25 * np.pi * diameter**2
    mass = density * area * length
    wave_numbers = [_wave_number(mode) / length for mode in range(1, bending_modes + 1)]
    stiffness_per_mass = elastic_modulus * diameter**2 / (16.0 * density)
    bending = [wave**2 * np.sqrt(stiffness_per_mass) / (2.0 * np.pi) for wave in wave_numbers]

    place = 0.5 * length * _NODES
    slopes = _slopes(place, length, wave_numbers) / np.sqrt(mass)
    polar_inertia = 0.125 * density * area * diameter**2  # per length
    gyroscopic = polar_inertia * (slopes.T * (0.5 * length * _WEIGHTS)) @ slopes
    weight = np.zeros(2 * (2 + bending_modes))
    weight[1] = -np.sqrt(mass)

    def in_both_planes(places: Sequence[float]) -> NDArray[np.float64]:
        shapes = _shapes(np.asarray(places, dtype=np.float64), length, wave_numbers) / np.sqrt(mass)
        return np.asarray(np.kron(shapes, np.eye(2)), dtype=np.float64)

    return ModalData(
        natural_frequencies=np.repeat([0.0, 0.0, *bending], 2),
        damping_ratios=np.repeat([0.0, 0.0, *[damping_ratio] * bending_modes], 2),
        bearings=in_both_planes(bearings),
        sensors=in_both_planes(sensors),
        unbalance=in_both_planes([0.0]),
        weight=weight,
        gyroscopic=np.kron(0.5 * (gyroscopic + gyroscopic.T), _TURN),
        description=f"uniform shaft, {length:g} m long, {diameter:g} m in diameter, {mass:g} kg",
    )


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not 0.0 < number(name, value, PlantError) < np.inf:
            raise PlantError(f"uniform shaft: {name} = {value:g}; it must be positive and finite")


def _check_places(length: float, **places_of: Sequence[float]) -> None:
    for name, places in places_of.items():
        places = numbers(name, places, PlantError).tolist()
        if len(places) != 2 or not -0.5 * length <= places[0] < places[1] <= 0.5 * length:
            raise PlantError(
                f"uniform shaft: {name} = {list(places)} m; needed: two positions, A below B, within "
                f"{0.5 * length:g} m of the middle"
            )


def _wave_number(mode: int) -> float:
    """Root of cos(b) cosh(b) = 1, divided by cosh(b) so that it stays small."""
    from scipy.optimize import brentq  # takes a quarter of a second to import

    guess = (mode + 0.5) * np.pi
    return float(brentq(lambda b: np.cos(b) - 1.0 / np.cosh(b), guess - 0.5, guess + 0.5))


def _shapes(place: NDArray[np.float64], length: float, wave_numbers: Sequence[float]) -> NDArray[np.float64]:
    """Shapes with a mean square of 1 over the shaft, at places from its middle (m), shape (places, modes)."""
    columns = [np.ones_like(place), np.sqrt(12.0) * place / length]
    for wave in wave_numbers:
        x, ratio = wave * (place + 0.5 * length), _ratio(wave * length)
        columns.append(np.cosh(x) + np.cos(x) - ratio * (np.sinh(x) + np.sin(x)))
    return np.column_stack(columns)


def _slopes(place: NDArray[np.float64], length: float, wave_numbers: Sequence[float]) -> NDArray[np.float64]:
    """Slopes of these shapes (1/m)."""
    columns = [np.zeros_like(place), np.full_like(place, np.sqrt(12.0) / length)]
    for wave in wave_numbers:
        x, ratio = wave * (place + 0.5 * length), _ratio(wave * length)
        columns.append(wave * (np.sinh(x) - np.sin(x) - ratio * (np.cosh(x) + np.cos(x))))
    return np.column_stack(columns)


def _ratio(b: float) -> float:
    return float((np.cosh(b) - np.cos(b)) / (np.sinh(b) - np.sin(b)))

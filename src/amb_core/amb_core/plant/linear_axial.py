"""Linear model of the rotor along its axis in the thrust bearing, about the position at which the controller holds it.

For each magnet, with its pull along e = +1 or -1 and all signals deviations from the operating point,

    N i = R phi - e R' phi_0 z + R_s (sum_n m_n + r dphi/dt),    V = N dphi/dt + R_c i
    dm_n/dt = c_n dphi/dt - p_n m_n
    m dv/dt = sum over magnets e R' phi_0 phi,    dz/dt = v,    R' = (1 / A_i + 1 / A_o) / mu_0

with phi_0 the flux at rest and R the reluctance at rest there. In place of the square root of s stand its terms, see
`amb_core.plant.thrust_bearing`. The amplifiers are averaged, or sampled as their modulation is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import PlantError
from amb_core.linear import LinearSystem
from amb_core.loop.control import ControllerParameters, pack_gains
from amb_core.plant.averaged import currents_without_integral
from amb_core.plant.axial import Axial
from amb_core.plant.differences import OpenPlant, plant_system, with_low_pass
from amb_core.plant.plant import Plant
from amb_core.plant.sampled_amplifiers import sample_modulated
from amb_core.plant.thrust_bearing import SIDES, half_order_terms, thrust_amplifier

_NAMES = ("+z", "-z")
_REFERENCES = np.array(SIDES)[:, np.newaxis]  # coil current references by the control current


@dataclass(frozen=True)
class AxialPoint:
    """Equilibrium of the rotor along its axis.

    Attributes
    ----------
    position : float
        Position z (m).
    current_reference : float
        Control current reference i_z that holds it (A).
    coil_current, flux : ndarray, shape (2,)
        Coil currents (A) and fluxes (Wb) of the magnets that pull along +z and -z.
    """

    position: float
    current_reference: float
    coil_current: NDArray[np.float64]
    flux: NDArray[np.float64]


def axial_point(controller: ControllerParameters, plant: Plant) -> AxialPoint | None:
    """Equilibrium with the controller; None without a thrust bearing.

    It lies off the nominal reference if an external force is constant, since there is no integral action.

    Raises
    ------
    PlantError
        If there is no equilibrium inside the axial backup bearing, or it needs more current than available.
    """
    axial, axes = plant.axial, len(plant.machine.axes)
    if axial is None:
        return None
    gain, reference = float(pack_gains(controller, axes)[-1, 0]), float(controller.references(axes)[-1])
    clearance, constant = plant.parameters.thrust_bearing.clearance, plant.parameters.rotor.constant_force[2]

    def held(z: float) -> AxialPoint:
        return _at_rest(plant, axial, z, gain * (reference - z))

    def unbalanced(z: float) -> float:
        return float(axial.circuit.pull * np.dot(SIDES, held(z).flux ** 2)) + constant

    z = _falling_root(unbalanced, clearance, reference)
    if z is None:
        raise PlantError(
            f"the controller with K_P = {gain:g} A/m on axis z cannot hold the rotor of {axial.mass:g} kg along its "
            f"axis inside the backup bearing, {clearance:g} m, against an external force of {constant:g} N"
        )
    point = held(z)
    if abs(point.current_reference) >= controller.current_limit:
        raise PlantError(
            f"holding the rotor along z needs a control current of {abs(point.current_reference):.3g} A; allowed: less "
            f"than the controller's limit, {controller.current_limit:g} A"
        )
    return point


def _falling_root(function: Callable[[float], float], clearance: float, near: float) -> float | None:
    """Zero inside the clearance at which a function of the position falls, the one next to `near`: a stable balance."""
    from scipy.optimize import brentq

    grid = np.linspace(-clearance, clearance, 401)[1:-1]
    values = np.array([function(z) for z in grid])
    falling = np.flatnonzero((values[:-1] > 0.0) & (values[1:] <= 0.0))
    if not len(falling):
        return None
    first = int(falling[np.argmin(np.abs(grid[falling] - near))])
    return float(brentq(function, grid[first], grid[first + 1], xtol=1e-16, rtol=1e-14))


def _at_rest(plant: Plant, axial: Axial, z: float, control_current: float) -> AxialPoint:
    """Currents and fluxes of amplifiers at rest, the disc held at z."""
    amplifier = thrust_amplifier(plant.parameters)
    current = amplifier.bias_current + np.array(SIDES) * control_current
    lowest = 0.0 if amplifier.limits or amplifier.unipolar else -np.inf
    current = np.clip(current, lowest, amplifier.current_limit if amplifier.limits else np.inf)
    if amplifier.integral_gain == 0.0:
        current = currents_without_integral(current, amplifier, plant.parameters.thrust_bearing.coil_resistance)
    flux = axial.circuit.turns * current / axial.circuit.reluctances(z)
    return AxialPoint(z, control_current, current, flux)


def open_axial(plant: Plant, axial: Axial, point: AxialPoint) -> OpenPlant:
    """The thrust bearing from coil voltages to coil currents and the measured position, without current controllers."""
    circuit, parameters = axial.circuit, plant.parameters
    terms = half_order_terms(circuit.lag)
    number, turns, resistance = len(terms.rates), circuit.turns, parameters.thrust_bearing.coil_resistance
    lagging = circuit.centred_reluctance
    states = [name for side in _NAMES for name in (f"flux_{side}", *(f"memory_{n}_{side}" for n in range(number)))]
    states += ["z", "v_z"]
    size, each = len(states), 1 + number
    z, v = size - 2, size - 1
    a, b, c, d = np.zeros((size, size)), np.zeros((size, 2)), np.zeros((2, size)), np.zeros((2, 2))
    for magnet, side in enumerate(SIDES):
        flux, memory = magnet * each, slice(magnet * each + 1, (magnet + 1) * each)
        slope = circuit.gap_reluctance * point.flux[magnet]  # of the drop per displacement, and of the force per flux
        drop = np.zeros(size)
        drop[flux], drop[memory], drop[z] = circuit.reluctances(point.position)[magnet], lagging, -side * slope
        inertia = turns + resistance / turns * lagging * terms.rest
        rate, by_voltage = -resistance / turns * drop / inertia, 1.0 / inertia
        a[flux], b[flux, magnet] = rate, by_voltage
        a[memory], b[memory, magnet] = np.outer(terms.weights, rate), terms.weights * by_voltage
        a[memory, memory] -= np.diag(terms.rates)
        c[magnet] = (drop + lagging * terms.rest * rate) / turns
        d[magnet, magnet] = lagging * terms.rest * by_voltage / turns
        a[v, flux] = side * slope / axial.mass
    a[z, v] = 1.0
    sensors = np.zeros((1, size))
    sensors[0, z] = 1.0
    a, b, sensors, states = with_low_pass(a, b, sensors, states, parameters.sensor.bandwidth, ["z"])
    return OpenPlant(a, b, np.hstack([c, np.zeros((2, len(a) - size))]), d, sensors, states, list(_NAMES))


def averaged_axial(plant: Plant, axial: Axial, point: AxialPoint) -> LinearSystem:
    """From the control current i_z (A) to the measured position z (m) with averaged amplifiers, continuous.

    With e = r - i and V = 2 U (K_P e + I), V follows from V = 2 U (K_P (r - C x - D V) + I).
    """
    opened, amplifier = open_axial(plant, axial, point), thrust_amplifier(plant.parameters)
    gain, size = 2.0 * amplifier.supply_voltage, len(opened.a)
    integrating = amplifier.integral_gain > 0.0
    at_once = np.linalg.inv(np.eye(2) + gain * amplifier.proportional_gain * opened.d)
    voltage = gain * at_once @ np.hstack([-amplifier.proportional_gain * opened.c, np.eye(2)])  # by states, integrals
    by_reference = gain * amplifier.proportional_gain * at_once @ _REFERENCES
    current = np.hstack([opened.c, np.zeros((2, 2))]) + opened.d @ voltage
    a = np.vstack([np.hstack([opened.a, np.zeros((size, 2))]) + opened.b @ voltage, -amplifier.integral_gain * current])
    b = np.vstack([opened.b @ by_reference, amplifier.integral_gain * (_REFERENCES - opened.d @ by_reference)])
    kept = size + 2 if integrating else size
    states = [*opened.states, *(f"integral_{side}" for side in _NAMES)][:kept]
    c = np.hstack([opened.sensors, np.zeros((1, 2))])[:, :kept]
    return plant_system(a[:kept, :kept], b[:kept], c, 0.0, ["z"], states)


def sampled_axial(plant: Plant, axial: Axial, point: AxialPoint) -> LinearSystem:
    """The same from sample to sample with the sampling of the modulation."""
    parameters = plant.parameters.model_copy(update={"amplifier": thrust_amplifier(plant.parameters)})
    return sample_modulated(open_axial(plant, axial, point), parameters, _REFERENCES, ["z"])

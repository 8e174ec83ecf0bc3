"""Converts the plant's parameters to the records and arrays of its compiled integrator."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0
from scipy.linalg import null_space

from amb_core.plant.closed_forms import inductance
from amb_core.plant.iron import pack_curve, pack_material, saturation_curve
from amb_core.plant.kernel import records
from amb_core.plant.kernel import rotor as modes_array
from amb_core.plant.kernel.advance import Arrays
from amb_core.plant.magnetostatics import Magnetostatics
from amb_core.plant.memory_terms import MemoryTerms
from amb_core.plant.network import (
    COILS,
    POLE_ANGLES,
    POLES,
    DiffusingIron,
    MagneticNetwork,
    active_coils,
    flux_constraints,
)
from amb_core.plant.parameters import PlantParameters
from amb_core.plant.rotor import RotorModel

_UNLIMITED = 1e12


def pack(
    parameters: PlantParameters,
    network: MagneticNetwork,
    magnetostatics: Magnetostatics,
    rotor: RotorModel | None,
) -> Arrays:
    """Records and arrays of a plant; its state is zero and must be set.

    Parameters
    ----------
    parameters : PlantParameters
        The plant.
    network : MagneticNetwork
        Its magnetic circuit, the same in both bearings.
    magnetostatics : Magnetostatics
        The magnetic circuit at rest.
    rotor : RotorModel or None
        Its rotor in two bearings; None for a point mass in one.
    """
    constants = records_of(records.CONSTANTS)
    record = constants[0]
    _pack_switches(record, parameters, network)
    _pack_network(record, parameters, network)
    pack_amplifier(record["amplifier"], parameters)
    record["amplifier"]["mean_by_ends"] = 0.0 if record["diffusion"] else 0.5
    _pack_rotor(record["rotor"], parameters)
    _pack_paths(record["paths"], parameters, network)
    if parameters.iron.laminations == "diffusion":
        for name, part in zip(("laminations", "solid"), network.diffusing, strict=False):
            _pack_part(record[name], part, parameters.integration.internal_step)
    elif parameters.iron.solid_journal:
        _pack_journal(record["journal"], parameters, network)
    if not parameters.iron.eddy_currents:
        _pack_balance(record["balance"], parameters, network, magnetostatics)
    if parameters.iron.hysteresis:
        record["material"] = pack_material(parameters.iron)
    elif parameters.iron.saturation:
        record["curve"] = pack_curve(parameters.iron)
    return Arrays(
        constants=constants,
        state=records_of(records.STATE),
        bearings=records_of(records.BEARING, 1 if rotor is None else records.MOST_BEARINGS),
        modes=np.zeros((0, 0)) if rotor is None else _pack_modes(rotor),
    )


def records_of(kind: np.dtype[Any], number: int = 1) -> NDArray[Any]:
    """Records of zeros that begin on a cache line, so that their speed does not depend on the memory address."""
    line = 64
    memory = np.zeros(number * kind.itemsize + line, dtype=np.uint8)
    first = -memory.ctypes.data % line
    return memory[first : first + number * kind.itemsize].view(kind)


def _pack_switches(record: np.void, parameters: PlantParameters, network: MagneticNetwork) -> None:
    """Switches of the effects, and the times of integration and sensors."""
    iron, amplifier, rotor = parameters.iron, parameters.amplifier, parameters.rotor
    record["step"] = parameters.integration.internal_step
    record["iron"] = iron.saturation + iron.hysteresis
    record["linear_iron"] = network.iron_reluctance.any()
    record["solid_journal"] = iron.solid_journal
    record["quasistatic"] = not iron.eddy_currents
    record["diffusion"] = iron.laminations == "diffusion"
    record["sensor_share"] = sensor_share(parameters)
    turning = rotor.unbalance != 0.0 and rotor.running_speed != 0.0
    disturbed = turning or rotor.external_force_x != 0.0 or rotor.external_force_y != 0.0
    plain_carriers = amplifier.carriers == "synchronous" and amplifier.dead_time == 0.0 and amplifier.limits
    record["rotor"]["disturbed"] = disturbed
    record["amplifier"]["plain_carriers"] = plain_carriers
    record["extended"] = (
        iron.saturation
        or iron.solid_journal
        or not iron.eddy_currents
        or iron.laminations == "diffusion"
        or disturbed
        or parameters.backup_bearing.contact
        or parameters.sensor.bandwidth > 0.0
        or not plain_carriers
    )


def sensor_share(parameters: PlantParameters) -> float:
    """Share of the distance to the position that the sensors' low-pass covers in an internal step.

    Backward Euler: its lag behind a ramp is exactly the time constant.
    """
    step, bandwidth = parameters.integration.internal_step, parameters.sensor.bandwidth
    lag = 1.0 / (2.0 * np.pi * bandwidth) if bandwidth > 0.0 else 0.0
    return step / (lag + step)


def _pack_network(record: np.void, parameters: PlantParameters, network: MagneticNetwork) -> None:
    record["gap"] = parameters.magnetic_circuit.air_gap
    record["gap_reluctance"] = network.gap_reluctance
    record["pull"] = 1.0 / (2.0 * mu_0 * network.pole_area)
    record["cosine"] = np.cos(POLE_ANGLES)
    record["sine"] = np.sin(POLE_ANGLES)
    record["reluctance"] = network.iron_reluctance
    by_columns = network.step_solution.T
    record["rate_by_drop"] = by_columns[:POLES, :POLES]
    record["current_by_drop"] = by_columns[:POLES, POLES:]
    record["rate_by_voltage"] = by_columns[POLES:, :POLES]
    record["current_by_voltage"] = by_columns[POLES:, POLES:]


def pack_amplifier(record: np.void, parameters: PlantParameters) -> None:
    """Write the amplifiers of a plant to a record of the kind AMPLIFIER."""
    amplifier = parameters.amplifier
    period = parameters.steps_per_period if amplifier.switching else 1
    record["supply"] = amplifier.supply_voltage
    record["duty_min"] = amplifier.minimum_duty if amplifier.limits else -_UNLIMITED
    record["duty_max"] = amplifier.maximum_duty if amplifier.limits else _UNLIMITED
    record["proportional_gain"] = amplifier.proportional_gain
    record["integral_gain"] = amplifier.integral_gain
    record["bias"] = amplifier.bias_current
    record["current_min"] = 0.0 if amplifier.limits or amplifier.unipolar else -_UNLIMITED
    record["current_max"] = amplifier.current_limit if amplifier.limits else _UNLIMITED
    record["period"] = period
    record["carrier_shift"] = period // COILS if amplifier.carriers == "interleaved" else 0
    record["dead_time"] = amplifier.dead_time * amplifier.switching_frequency * period
    record["unipolar"] = amplifier.unipolar


def _pack_rotor(record: np.void, parameters: PlantParameters) -> None:
    rotor, contact = parameters.rotor, parameters.backup_bearing
    record["mass"] = rotor.mass
    record["gravity"] = rotor.gravity
    record["free_x"] = parameters.magnetic_circuit.actuators == "two_axis"
    record["speed"] = 2.0 * np.pi * rotor.running_speed
    record["unbalance"] = rotor.unbalance
    record["external_force"] = rotor.external_force_x, rotor.external_force_y
    record["external_frequency"] = 2.0 * np.pi * rotor.external_force_frequency
    record["backup_radius"] = rotor.backup_bearing_radius
    record["contact"] = contact.contact
    record["contact_stiffness"] = contact.stiffness
    record["contact_damping"] = contact.damping
    record["friction"] = contact.friction
    record["journal_radius"] = parameters.magnetic_circuit.journal_outer_radius


def _pack_paths(record: np.void, parameters: PlantParameters, network: MagneticNetwork) -> None:
    circuit = parameters.magnetic_circuit
    segments = len(network.to_segments)
    record["to_segments"][:, :segments] = network.to_segments.T
    record["to_poles"][:segments] = network.to_segments
    for path, (length, area) in enumerate(network.paths):
        record["length"][path] = length
        record["area"][path] = area
    if parameters.iron.solid_journal:
        record["length"][2] = 0.0  # its iron is linear and part of the matrices
    # Separate circuits have no rings; without eddy currents their fluxes have no rates.
    if circuit.coupling and parameters.iron.eddy_currents:
        record["circulation"] = 12.0 / (circuit.iron_conductivity * circuit.lamination_thickness**2)
    # Half of the limit of Adams-Bashforth for the decay of an unlinked flux, 12 nu / (sigma d^2), nu = 1 / mu_0 - dM/dB
    step, extrapolated = parameters.integration.internal_step, 1.0 / mu_0
    eddies = circuit.iron_conductivity * circuit.lamination_thickness**2 / 12.0
    if parameters.iron.laminations == "diffusion":
        linear = 1.0 / (mu_0 * circuit.relative_permeability)  # left out of what is extrapolated
        eddies, extrapolated = linear * network.diffusing[0].terms.mean(step)[1], extrapolated - linear
    record["stiff_slope"] = extrapolated - 0.5 * eddies / step
    record["stiff_density"] = np.inf
    if parameters.iron.hysteresis and parameters.iron.laminations == "diffusion":
        record["stiff_density"] = _stiff_density(parameters, float(record["stiff_slope"]))


def _stiff_density(parameters: PlantParameters, stiff_slope: float) -> float:
    """Flux density (T) above which iron with hysteresis is stiff after a reversal, when only its reversible part moves.

    Diffusion delays fluxes so little that a step cannot wait for the slope to change.
    """
    curve = saturation_curve(parameters.iron)
    flux_density = np.linspace(0.0, curve.end, 2000)
    susceptibility = 1.0 / (mu_0 * curve.differential_reluctivity(flux_density)) - 1.0
    reversible = parameters.iron.reversibility * susceptibility
    stiff = reversible / (1.0 + reversible) < mu_0 * stiff_slope
    return float(flux_density[np.argmax(stiff)]) if stiff.any() else np.inf


def _pack_journal(record: np.void, parameters: PlantParameters, network: MagneticNetwork) -> None:
    (solid,) = network.diffusing
    journal = solid.terms
    terms = len(journal.rates)
    record["reluctance"] = solid.reluctance
    record["terms"] = terms
    record["keep"][:terms], record["gain"][:terms] = journal.update(parameters.integration.internal_step)
    record["weight"] = journal.weights.sum()


def _pack_part(record: np.void, part: DiffusingIron, step: float) -> None:
    record["reluctance"] = part.reluctance
    pack_terms(record, part.terms, step)


def pack_terms(record: np.void, memory: MemoryTerms, step: float) -> None:
    """Write the memories of diffusing flux, as means over the step, to a record with places for them."""
    terms = len(memory.rates)
    shares, record["coefficient"] = memory.mean(step)
    keep, gain = memory.update(step)
    record["terms"] = terms
    record["keep"][:terms], record["gain"][:terms] = keep, shares * gain * step


def _pack_balance(
    record: np.void, parameters: PlantParameters, network: MagneticNetwork, magnetostatics: Magnetostatics
) -> None:
    """Directions in which fluxes settle without eddy currents."""
    circuit = parameters.magnetic_circuit
    bound = np.hstack([network.winding[:, active_coils(circuit)], flux_constraints(circuit.coupling)])
    of_poles = null_space(bound.T)
    rings = magnetostatics.rings
    size = of_poles.shape[1] + len(rings)
    free = np.zeros((records.FLUXES, size))
    free[:POLES, : of_poles.shape[1]] = of_poles
    free[POLES + rings, of_poles.shape[1] + np.arange(len(rings))] = 1.0
    record["size"] = size
    record["inductance"] = inductance(circuit)
    record["directions"][:, :size] = free
    record["densities"][:, :size] = magnetostatics.to_flux_density @ free
    record["reluctance"][:size, :size] = free[:POLES].T @ network.iron_reluctance @ free[:POLES]


def _pack_modes(rotor: RotorModel) -> NDArray[np.float64]:
    """A rotor's equation of motion, solved for the accelerations."""
    modes = np.zeros((modes_array.STIFFNESS + 2 * rotor.n, rotor.n))
    modes[modes_array.INPUTS : modes_array.INPUTS + 4] = np.linalg.solve(rotor.mass, rotor.bearings.T).T
    modes[modes_array.UNBALANCE : modes_array.UNBALANCE + 2] = np.linalg.solve(rotor.mass, rotor.unbalance.T).T
    modes[modes_array.WEIGHT] = np.linalg.solve(rotor.mass, rotor.weight)
    modes[modes_array.POSITIONS : modes_array.POSITIONS + 4] = rotor.bearings
    modes[modes_array.SENSORS : modes_array.SENSORS + 4] = rotor.sensors
    by_rate = modes_array.STIFFNESS + rotor.n
    modes[modes_array.STIFFNESS : by_rate] = -np.linalg.solve(rotor.mass, rotor.stiffness).T
    modes[by_rate:] = -np.linalg.solve(rotor.mass, rotor.damping + rotor.gyroscopic).T
    return modes

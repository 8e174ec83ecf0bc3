"""The plant's parameters as the arrays that its compiled integrator works on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0
from scipy.linalg import null_space

from amb_core.plant.closed_forms import inductance
from amb_core.plant.eddy import solid_journal_terms
from amb_core.plant.iron import pack_curve, pack_material
from amb_core.plant.kernel import iron_paths, layout, quasistatic
from amb_core.plant.kernel.advance import Arrays
from amb_core.plant.kernel.iron import ELEMENTS
from amb_core.plant.magnetostatics import Magnetostatics
from amb_core.plant.network import COILS, POLE_ANGLES, POLES, MagneticNetwork, active_coils, flux_constraints
from amb_core.plant.parameters import MagneticCircuitParameters, PlantParameters
from amb_core.plant.rotor import RotorModel

_UNLIMITED = 1e12


def pack(
    parameters: PlantParameters,
    network: MagneticNetwork,
    magnetostatics: Magnetostatics,
    rotor: RotorModel | None,
) -> Arrays:
    """Arrays of a plant; its state is zero and must be set.

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
    bearings, coordinates = (1, 0) if rotor is None else (2, rotor.n)
    iron = parameters.iron
    diffusion = _pack_diffusion(parameters)
    return Arrays(
        state=_on_cache_lines(np.zeros(layout.HEAD_SIZE + bearings * layout.BLOCK_SIZE + 4 * coordinates)),
        constants=_pack_constants(parameters, network),
        matrices=_on_cache_lines(_pack_matrices(network)),
        work=_on_cache_lines(np.zeros(bearings * layout.WORK_SIZE)),
        iron=np.zeros((bearings if iron.saturation else 0, iron_paths.IRON_SIZE, ELEMENTS)),
        material=pack_material(iron) if iron.hysteresis else np.zeros(0),
        curve=pack_curve(iron) if iron.saturation and not iron.hysteresis else np.zeros((0, 0)),
        paths=_pack_paths(parameters, network),
        diffusion=np.repeat(diffusion[np.newaxis], bearings if iron.solid_journal else 0, axis=0),
        quasistatic=np.zeros((0, 0))
        if iron.eddy_currents
        else _pack_quasistatic(parameters.magnetic_circuit, network, magnetostatics),
        modes=np.zeros((0, 0)) if rotor is None else _pack_modes(rotor),
        force=np.zeros(4),
    )


def _on_cache_lines(array: NDArray[np.float64]) -> NDArray[np.float64]:
    """The array at an address that begins a cache line, so that its speed does not depend on where memory was free."""
    line = 64
    memory = np.zeros(array.nbytes + line, dtype=np.uint8)
    first = -memory.ctypes.data % line
    aligned = memory[first : first + array.nbytes].view(np.float64).reshape(array.shape)
    aligned[...] = array
    return aligned


def _pack_constants(parameters: PlantParameters, network: MagneticNetwork) -> NDArray[np.float64]:
    amplifier, rotor, contact = parameters.amplifier, parameters.rotor, parameters.backup_bearing
    step = parameters.integration.internal_step
    solid = parameters.iron.solid_journal
    period = parameters.steps_per_period if amplifier.switching else 1
    constants = np.zeros(layout.CONSTANTS_SIZE)
    constants[layout.STEP] = step
    constants[layout.GAP] = parameters.magnetic_circuit.air_gap
    constants[layout.GAP_RELUCTANCE] = network.gap_reluctance
    constants[layout.FORCE] = 1.0 / (2.0 * mu_0 * network.pole_area)
    constants[layout.RADIUS] = rotor.backup_bearing_radius

    constants[layout.SUPPLY] = amplifier.supply_voltage
    constants[layout.DUTY_MIN] = amplifier.minimum_duty if amplifier.limits else -_UNLIMITED
    constants[layout.DUTY_MAX] = amplifier.maximum_duty if amplifier.limits else _UNLIMITED
    constants[layout.KP] = amplifier.proportional_gain
    constants[layout.KI] = amplifier.integral_gain
    constants[layout.BIAS] = amplifier.bias_current
    constants[layout.CURRENT_MIN] = 0.0 if amplifier.limits or amplifier.unipolar else -_UNLIMITED
    constants[layout.CURRENT_MAX] = amplifier.current_limit if amplifier.limits else _UNLIMITED
    constants[layout.PERIOD] = period
    constants[layout.CARRIER_SHIFT] = period // COILS if amplifier.carriers == "interleaved" else 0
    constants[layout.DEAD_TIME] = amplifier.dead_time * amplifier.switching_frequency * period
    constants[layout.UNIPOLAR] = amplifier.unipolar
    constants[layout.PLAIN_CARRIERS] = (
        amplifier.carriers == "synchronous" and amplifier.dead_time == 0.0 and amplifier.limits
    )

    constants[layout.MASS] = rotor.mass
    constants[layout.GRAVITY] = rotor.gravity
    constants[layout.FREE_X] = parameters.magnetic_circuit.actuators == "two_axis"
    constants[layout.FORCE_X] = rotor.external_force_x
    constants[layout.FORCE_Y] = rotor.external_force_y
    constants[layout.FORCE_FREQUENCY] = 2.0 * np.pi * rotor.external_force_frequency
    constants[layout.UNBALANCE] = rotor.unbalance
    constants[layout.SPEED] = 2.0 * np.pi * rotor.running_speed
    turning = rotor.unbalance != 0.0 and rotor.running_speed != 0.0
    constants[layout.DISTURBED] = turning or rotor.external_force_x != 0.0 or rotor.external_force_y != 0.0
    constants[layout.CONTACT] = contact.contact
    constants[layout.CONTACT_STIFFNESS] = contact.stiffness
    constants[layout.CONTACT_DAMPING] = contact.damping
    constants[layout.FRICTION] = contact.friction
    constants[layout.JOURNAL_RADIUS] = parameters.magnetic_circuit.journal_outer_radius

    constants[layout.NONLINEAR_IRON] = parameters.iron.saturation + parameters.iron.hysteresis
    constants[layout.QUASISTATIC] = not parameters.iron.eddy_currents
    constants[layout.INDUCTANCE] = inductance(parameters.magnetic_circuit)
    # Half of what Adams-Bashforth allows the decay of an unlinked flux, 12 nu / (sigma d^2) with nu = 1 / mu_0 - dM/dB
    circuit = parameters.magnetic_circuit
    eddies = circuit.iron_conductivity * circuit.lamination_thickness**2 / 12.0
    constants[layout.STIFF_SLOPE] = 1.0 / mu_0 - 0.5 * eddies / step
    constants[layout.DIFFUSING_WEIGHT] = solid_journal_terms(parameters).weights.sum() if solid else 0.0
    constants[layout.LINEAR_IRON] = network.iron_reluctance.any()
    constants[layout.SOLID_JOURNAL] = parameters.iron.solid_journal
    # Backward Euler: its lag behind a ramp is exactly the time constant.
    bandwidth = parameters.sensor.bandwidth
    lag = 1.0 / (2.0 * np.pi * bandwidth) if bandwidth > 0.0 else 0.0
    constants[layout.SENSOR_LAG] = step / (lag + step)
    effects = (layout.NONLINEAR_IRON, layout.SOLID_JOURNAL, layout.QUASISTATIC, layout.DISTURBED, layout.CONTACT)
    constants[layout.EXTENDED] = (
        constants[list(effects)].any() or bandwidth > 0.0 or not constants[layout.PLAIN_CARRIERS]
    )
    return constants


def _pack_matrices(network: MagneticNetwork) -> NDArray[np.float64]:
    matrices = np.zeros((layout.MATRICES_SIZE, POLES + COILS))
    matrices[layout.RELUCTANCE : layout.RELUCTANCE + POLES, :POLES] = network.iron_reluctance
    matrices[layout.SOLUTION : layout.SOLUTION + POLES + COILS] = network.solution.T
    matrices[layout.COSINE, :POLES] = np.cos(POLE_ANGLES)
    matrices[layout.SINE, :POLES] = np.sin(POLE_ANGLES)
    return matrices


def _pack_paths(parameters: PlantParameters, network: MagneticNetwork) -> NDArray[np.float64]:
    paths = np.zeros((iron_paths.PATHS_SIZE, POLES))
    segments = len(network.to_segments)
    paths[iron_paths.SEGMENTS : iron_paths.SEGMENTS + POLES, :segments] = network.to_segments.T
    paths[iron_paths.TO_POLES : iron_paths.TO_POLES + segments] = network.to_segments
    paths[iron_paths.DIFFUSING : iron_paths.DIFFUSING + POLES] = network.journal_reluctance
    scalars = paths[iron_paths.SCALARS]
    for path, (length, area) in enumerate(network.paths):
        scalars[iron_paths.POLE_LENGTH + path] = length
        scalars[iron_paths.POLE_AREA + path] = area
    if parameters.iron.solid_journal:
        scalars[iron_paths.JOURNAL_LENGTH] = 0.0  # its iron is linear and stands in the matrices
    circuit = parameters.magnetic_circuit
    # Separate circuits have no rings; without eddy currents their fluxes have no rates.
    if circuit.coupling and parameters.iron.eddy_currents:
        scalars[iron_paths.CIRCULATION] = 12.0 / (circuit.iron_conductivity * circuit.lamination_thickness**2)
    return paths


def _pack_diffusion(parameters: PlantParameters) -> NDArray[np.float64]:
    if not parameters.iron.solid_journal:
        return np.zeros((0, iron_paths.DIFFUSION_COLUMNS))
    journal = solid_journal_terms(parameters)
    diffusion = np.zeros((len(journal.rates) + 2, iron_paths.DIFFUSION_COLUMNS))
    keep, gain = journal.update(parameters.integration.internal_step)
    diffusion[:-2, iron_paths.TERM_KEEP] = keep
    diffusion[:-2, iron_paths.TERM_GAIN] = gain
    return diffusion


def _pack_quasistatic(
    circuit: MagneticCircuitParameters, network: MagneticNetwork, magnetostatics: Magnetostatics
) -> NDArray[np.float64]:
    """Directions in which fluxes settle without eddy currents."""
    bound = np.hstack([network.winding[:, active_coils(circuit)], flux_constraints(circuit.coupling)])
    directions = null_space(bound.T)
    rings = magnetostatics.rings
    free = np.zeros((quasistatic.FLUXES, directions.shape[1] + len(rings)))
    free[:POLES, : directions.shape[1]] = directions
    free[POLES + rings, directions.shape[1] + np.arange(len(rings))] = 1.0
    of_poles = free[:POLES]
    array = np.zeros((quasistatic.QUASISTATIC_SIZE, free.shape[1]))
    array[: quasistatic.FLUXES] = free
    array[quasistatic.DENSITIES : quasistatic.LINEAR] = magnetostatics.to_flux_density @ free
    array[quasistatic.LINEAR : quasistatic.LINEAR + free.shape[1]] = of_poles.T @ network.iron_reluctance @ of_poles
    return array


def _pack_modes(rotor: RotorModel) -> NDArray[np.float64]:
    """A rotor's equation of motion, solved for the accelerations."""
    modes = np.zeros((layout.MODE_STIFFNESS + 2 * rotor.n, rotor.n))
    modes[layout.MODE_INPUTS : layout.MODE_INPUTS + 4] = np.linalg.solve(rotor.mass, rotor.bearings.T).T
    modes[layout.MODE_UNBALANCE : layout.MODE_UNBALANCE + 2] = np.linalg.solve(rotor.mass, rotor.unbalance.T).T
    modes[layout.MODE_WEIGHT] = np.linalg.solve(rotor.mass, rotor.weight)
    modes[layout.MODE_POSITIONS : layout.MODE_POSITIONS + 4] = rotor.bearings
    modes[layout.MODE_SENSORS : layout.MODE_SENSORS + 4] = rotor.sensors
    by_rate = layout.MODE_STIFFNESS + rotor.n
    modes[layout.MODE_STIFFNESS : by_rate] = -np.linalg.solve(rotor.mass, rotor.stiffness).T
    modes[by_rate:] = -np.linalg.solve(rotor.mass, rotor.damping + rotor.gyroscopic).T
    return modes

"""Compiled integrator of the thrust bearing: amplifiers, fluxes, forces, axial motion, backup bearing and sensor.

Over an internal step h the mean coil voltage V is known and the flux changes at a constant rate, so all drops are means
over the step (as those of `laminations`): with phi and the memories w_n = alpha_n m_n at its start,

    d = R(z) phi + R_s sum_n w_n,    e = R(z) h / 2 + R_s k
    dphi/dt = (N V - R_c d) / (N^2 + R_c e),    i = (d + e dphi/dt) / N
    w_n <- exp(-p_n h) w_n + c_n alpha_n^2 h dphi/dt

R(z) is that of the gap in the middle of the step. This is implicit (trapezoidal), so terms may be faster than a step. A
coil current that would be negative is zero: diodes raise the voltage.

The amplifiers are those of `amplifiers` (PI on the mean current of the past switching period, regular sampling, a
pulse in the middle of the period), and the motion m z'' = f_1 - f_2 + f_external + f_contact the scheme of `rotor`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from amb_core.plant.kernel.amplifiers import coil_reference, count_step, delayed_voltage, update_duty
from amb_core.plant.kernel.records import AMPLIFIER, DELEVITATED, GAP_CLOSED, NOT_FINITE, OK
from amb_core.plant.kernel.rotor import moved, push
from amb_core.plant.kernel.trace import write_values
from amb_core.plant.memory_terms import MOST_TERMS

MAGNETS = 2

AXIAL_CONSTANTS = np.dtype(
    [
        ("step", float),  # internal step h (s)
        ("mass", float),  # of the rotor (kg)
        ("gap", float),  # of each magnet, disc centred (m)
        ("gap_reluctance", float),  # of one metre of gap (A/(Wb m))
        ("iron_reluctance", float),  # at rest (A/Wb)
        ("pull", float),  # force per square of the flux (N/Wb^2)
        ("turns", float),
        ("resistance", float),  # of a coil (ohm)
        ("lag_reluctance", float),  # R_s (A/Wb)
        ("coefficient", float),  # k (s)
        ("terms", np.int64),
        ("keep", float, (MOST_TERMS,)),  # exp(-p_n h)
        ("gain", float, (MOST_TERMS,)),  # c_n alpha_n^2 h (s)
        ("amplifier", AMPLIFIER),
        ("external_force", float),  # amplitude (N)
        ("external_frequency", float),  # angular (rad/s)
        ("clearance", float),  # displacement at which the rotor touches the backup bearing (m)
        ("contact", np.bool_),  # a contact is simulated; otherwise it ends the run
        ("contact_stiffness", float),  # N/m
        ("contact_damping", float),  # N s/m
        ("sensor_share", float),  # of the distance to the position that the sensor's low-pass covers in a step
    ],
    align=True,
)

AXIAL_STATE = np.dtype(
    [
        ("started", np.bool_),  # after the first internal step
        ("steps", np.int64),  # internal steps since the reset
        ("phase", np.int64),  # internal step within the switching period
        ("position", float),  # m
        ("velocity", float),  # m/s
        ("acceleration", float),  # at the previous step (m/s^2)
        ("sensed", float),  # position behind the sensor's low-pass (m)
        ("contact_force", float),  # of the backup bearing (N)
        # Of the magnets that pull along +z and -z
        ("flux", float, (MAGNETS,)),  # Wb
        ("rate", float, (MAGNETS,)),  # of the flux over this step (Wb/s)
        ("force", float, (MAGNETS,)),  # magnitude at the start of this step (N)
        ("current", float, (MAGNETS,)),  # mean over this step (A)
        ("voltage", float, (MAGNETS,)),  # mean over this step (V)
        ("reference", float, (MAGNETS,)),  # of the coil currents (A)
        ("integral", float, (MAGNETS,)),  # parts of the PI controllers (duty)
        ("current_sum", float, (MAGNETS,)),  # over the switching period (A)
        ("current_start", float, (MAGNETS,)),  # at the start of the period (A)
        ("duty", float, (MAGNETS,)),
        ("mean", float, (MAGNETS, MOST_TERMS)),  # alpha_n m_n (Wb)
    ],
    align=True,
)

FIELDS = {
    "flux": MAGNETS,
    "flux_rate": MAGNETS,
    "current": MAGNETS,
    "voltage": MAGNETS,
    "force": MAGNETS,
    "position": 1,
    "velocity": 1,
    "contact_force": 1,
}
"""What a row of a trace has, with the number of columns, in the order of `_write`."""
ROW_SIZE = sum(FIELDS.values())


@numba.njit(cache=True, error_model="numpy")
def advance_axial(constants, state, reference, steps, trace):
    """Advance the thrust bearing by `steps` internal steps with the control current reference held.

    Parameters
    ----------
    constants, state : ndarray of AXIAL_CONSTANTS and of AXIAL_STATE, shape (1,)
        The thrust bearing; the state is changed in place.
    reference : float
        Control current reference (A), finite.
    steps : int
        Internal steps.
    trace : ndarray, shape (steps, ROW_SIZE) or (0, ROW_SIZE)
        Receives the variables at the start of every internal step if it has rows.

    Returns
    -------
    int
        OK, DELEVITATED (the rotor touched the axial backup bearing), NOT_FINITE, or GAP_CLOSED (the disc reached the
        poles in spite of it).
    """
    plant, bearing = constants[0], state[0]
    amplifier = plant.amplifier
    for magnet in range(MAGNETS):
        bearing.reference[magnet] = coil_reference(amplifier, reference if magnet == 0 else -reference)
    for step in range(steps):
        if bearing.phase == 0:
            for magnet in range(MAGNETS):
                update_duty(amplifier, bearing, magnet, plant.step)
        middle = bearing.position + 0.5 * plant.step * bearing.velocity
        for magnet in range(MAGNETS):
            gap = plant.gap - middle if magnet == 0 else plant.gap + middle
            duty, current = bearing.duty[magnet], bearing.current[magnet]
            bearing.voltage[magnet] = delayed_voltage(amplifier, duty, current, bearing.phase)
            _set_rate(plant, bearing, magnet, gap)
            bearing.force[magnet] = plant.pull * bearing.flux[magnet] * bearing.flux[magnet]
        if plant.contact:
            _set_contact_force(plant, bearing)
        if trace.shape[0] > 0:
            _write(bearing, trace[step])
        for magnet in range(MAGNETS):
            _diffuse(plant, bearing, magnet)
            bearing.flux[magnet] += plant.step * bearing.rate[magnet]
            bearing.current_sum[magnet] += bearing.current[magnet]
        _move(plant, bearing)
        bearing.sensed += plant.sensor_share * (bearing.position - bearing.sensed)
        count_step(plant, bearing)
    if plant.sensor_share == 1.0:
        bearing.sensed = bearing.position  # exactly
    return _status(plant, bearing)


@numba.njit(inline="always", error_model="numpy")
def _set_rate(plant, bearing, magnet, gap):
    """Rate of the flux over the step and mean coil current."""
    turns, resistance = plant.turns, plant.resistance
    memories = 0.0
    for term in range(plant.terms):
        memories += bearing.mean[magnet, term]
    reluctance = gap * plant.gap_reluctance + plant.iron_reluctance
    drop = reluctance * bearing.flux[magnet] + plant.lag_reluctance * memories
    slope = 0.5 * plant.step * reluctance + plant.lag_reluctance * plant.coefficient
    rate = (turns * bearing.voltage[magnet] - resistance * drop) / (turns * turns + resistance * slope)
    current = (drop + slope * rate) / turns
    if plant.amplifier.unipolar and current < 0.0:
        rate = -drop / slope
        current = 0.0
        bearing.voltage[magnet] = turns * rate
    bearing.rate[magnet] = rate
    bearing.current[magnet] = current


@numba.njit(inline="always", error_model="numpy")
def _diffuse(plant, bearing, magnet):
    """Move the memories over the step."""
    for term in range(plant.terms):
        moved = plant.keep[term] * bearing.mean[magnet, term] + plant.gain[term] * bearing.rate[magnet]
        bearing.mean[magnet, term] = moved


@numba.njit(inline="always", error_model="numpy")
def _set_contact_force(plant, bearing):
    """Axial backup bearing: spring and damper that only push."""
    side = 1.0 if bearing.position > 0.0 else -1.0
    depth = side * bearing.position - plant.clearance
    bearing.contact_force = -side * push(plant, depth, side * bearing.velocity) if depth > 0.0 else 0.0


@numba.njit(inline="always", error_model="numpy")
def _move(plant, bearing):
    """Move the rotor along its axis by one step."""
    force = bearing.force[0] - bearing.force[1] + bearing.contact_force
    if plant.external_force != 0.0:
        force += plant.external_force * math.cos(plant.external_frequency * (bearing.steps * plant.step))
    acceleration = force / plant.mass
    if not bearing.started:
        bearing.acceleration = acceleration
    bearing.position, bearing.velocity = moved(
        plant.step, bearing.position, bearing.velocity, acceleration, bearing.acceleration
    )
    bearing.acceleration = acceleration


@numba.njit(inline="always", error_model="numpy")
def _write(bearing, row):
    """Variables at the start of the step, after its voltages and before it moves anything."""
    column = write_values(bearing.flux, row, 0)
    column = write_values(bearing.rate, row, column)
    column = write_values(bearing.current, row, column)
    column = write_values(bearing.voltage, row, column)
    column = write_values(bearing.force, row, column)
    row[column] = bearing.position
    row[column + 1] = bearing.velocity
    row[column + 2] = bearing.contact_force


@numba.njit(inline="always", error_model="numpy")
def _status(plant, bearing):
    distance = abs(bearing.position)
    if not math.isfinite(distance):
        return NOT_FINITE
    if plant.contact:
        return GAP_CLOSED if distance >= plant.gap else OK
    return DELEVITATED if distance >= plant.clearance else OK

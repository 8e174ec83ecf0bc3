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

from amb_core.plant.kernel.amplifiers import regulate
from amb_core.plant.kernel.records import AMPLIFIER, DELEVITATED, GAP_CLOSED, NOT_FINITE, OK
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
        ("duty", float, (MAGNETS,)),
        ("mean", float, (MAGNETS, MOST_TERMS)),  # alpha_n m_n (Wb)
    ],
    align=True,
)

FIELDS = ("flux", "flux_rate", "current", "voltage", "force", "position", "velocity", "contact_force")
"""What a row of a trace has: the first five of both magnets, then a column each."""
ROW_SIZE = 5 * MAGNETS + 3


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
        wanted = amplifier.bias + (reference if magnet == 0 else -reference)
        bearing.reference[magnet] = min(max(wanted, amplifier.current_min), amplifier.current_max)
    for step in range(steps):
        if bearing.phase == 0:
            _set_duties(amplifier, bearing, plant.step)
        middle = bearing.position + 0.5 * plant.step * bearing.velocity
        for magnet in range(MAGNETS):
            gap = plant.gap - middle if magnet == 0 else plant.gap + middle
            _set_voltage(amplifier, bearing, magnet)
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
        bearing.started = True
        bearing.steps += 1
        bearing.phase = bearing.phase + 1 if bearing.phase + 1 < amplifier.period else 0
    if plant.sensor_share == 1.0:
        bearing.sensed = bearing.position  # exactly
    return _status(plant, bearing)


@numba.njit(inline="always", error_model="numpy")
def _set_duties(amplifier, bearing, step):
    """Duty cycles for the switching period that begins; the currents are means over the steps."""
    for magnet in range(MAGNETS):
        error = bearing.reference[magnet] - bearing.current_sum[magnet] / float(amplifier.period)
        duty, integral = regulate(amplifier, error, bearing.integral[magnet], step)
        bearing.duty[magnet], bearing.integral[magnet] = duty, integral
        bearing.current_sum[magnet] = 0.0


@numba.njit(inline="always", error_model="numpy")
def _set_voltage(amplifier, bearing, magnet):
    """Mean coil voltage over this internal step; dead time delays the edge that drives the current further."""
    dead = amplifier.dead_time if bearing.current[magnet] >= 0.0 else -amplifier.dead_time
    if amplifier.period == 1:  # a switching period of one internal step has the average voltage
        bearing.voltage[magnet] = amplifier.supply * (2.0 * (bearing.duty[magnet] - dead) - 1.0)
        return
    middle, half = 0.5 * amplifier.period, 0.5 * amplifier.period * bearing.duty[magnet]
    start, end = middle - half + max(dead, 0.0), middle + half + max(-dead, 0.0)
    on = min(bearing.phase + 1.0, end) - max(float(bearing.phase), start)
    bearing.voltage[magnet] = amplifier.supply * (2.0 * min(max(on, 0.0), 1.0) - 1.0)


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
    normal = plant.contact_stiffness * depth + plant.contact_damping * side * bearing.velocity
    bearing.contact_force = -side * max(normal, 0.0) if depth > 0.0 else 0.0


@numba.njit(inline="always", error_model="numpy")
def _move(plant, bearing):
    """Move the rotor along its axis by one step."""
    force = bearing.force[0] - bearing.force[1] + bearing.contact_force
    if plant.external_force != 0.0:
        force += plant.external_force * math.cos(plant.external_frequency * (bearing.steps * plant.step))
    acceleration = force / plant.mass
    if not bearing.started:
        bearing.acceleration = acceleration
    velocity = bearing.velocity
    bearing.velocity += plant.step * (1.5 * acceleration - 0.5 * bearing.acceleration)
    bearing.position += 0.5 * plant.step * (velocity + bearing.velocity)
    bearing.acceleration = acceleration


@numba.njit(inline="always", error_model="numpy")
def _write(bearing, row):
    """Variables at the start of the step, after its voltages and before it moves anything."""
    for magnet in range(MAGNETS):
        row[magnet] = bearing.flux[magnet]
        row[MAGNETS + magnet] = bearing.rate[magnet]
        row[2 * MAGNETS + magnet] = bearing.current[magnet]
        row[3 * MAGNETS + magnet] = bearing.voltage[magnet]
        row[4 * MAGNETS + magnet] = bearing.force[magnet]
    row[5 * MAGNETS] = bearing.position
    row[5 * MAGNETS + 1] = bearing.velocity
    row[5 * MAGNETS + 2] = bearing.contact_force


@numba.njit(inline="always", error_model="numpy")
def _status(plant, bearing):
    distance = abs(bearing.position)
    if not math.isfinite(distance):
        return NOT_FINITE
    if plant.contact:
        return GAP_CLOSED if distance >= plant.gap else OK
    return DELEVITATED if distance >= plant.clearance else OK

"""Compiled parts of the integrator that move the rotor: point mass, modes, disturbances, backup bearings, sensors.

A point mass m in one bearing has m (x'', y'') = f_magnetic + f_contact + f_external + f_unbalance - (0, m g). A rotor
with generalised coordinates q in two bearings has, solved for the accelerations,

    q'' = w + K^T q + D^T q' + sum_axes b_axis f_axis + sum u f_unbalance,    journal positions = P q

Velocities advance by the second-order Adams-Bashforth method, positions by the trapezoidal rule. All that concerns the
coordinates lies in the rows of one array, a column per coordinate.
"""

from __future__ import annotations

import math

import numba

# Rows of the array of modes. State: coordinates, rates, accelerations at the previous step and now.
COORDINATE, RATE, PREVIOUS, ACCELERATION = range(4)
INPUTS = 4  # acceleration per force b: in bearing A x, y and B x, y (4)
UNBALANCE = 8  # acceleration per force u of the unbalance x, y (2)
FORCES = 6  # rows from INPUTS on
WEIGHT = 10  # acceleration w by gravity
POSITIONS = 11  # displacement of the journals P: in bearing A x, y and B x, y (4)
SENSORS = 15  # displacement at the sensors (4)
STIFFNESS = 19  # columns of the acceleration per coordinate (n), then those per rate (n)

_RUBBING_SPEED = 1e-3
"""Sliding speed (m/s) from which friction is fully there; below, it grows in proportion."""


@numba.njit(cache=True, error_model="numpy")
def set_disturbance(constants, state):
    """External force at bearing A and force of the unbalance at the present time (N)."""
    rotor = constants.rotor
    time = state.steps * constants.step
    wave = math.cos(rotor.external_frequency * time)
    state.external_force[0] = rotor.external_force[0] * wave
    state.external_force[1] = rotor.external_force[1] * wave
    turning = rotor.unbalance * rotor.speed * rotor.speed
    state.unbalance_force[0] = turning * math.cos(rotor.speed * time)
    state.unbalance_force[1] = turning * math.sin(rotor.speed * time)


@numba.njit(cache=True, error_model="numpy")
def set_contact_force(rotor, bearing):
    """Backup bearing: spring, damper that only pushes, and friction against the surface of the turning journal."""
    x, y = bearing.position[0], bearing.position[1]
    bearing.contact_force[0] = 0.0
    bearing.contact_force[1] = 0.0
    distance = math.sqrt(x * x + y * y)
    depth = distance - rotor.backup_radius
    if depth <= 0.0:
        return
    v_x, v_y = bearing.velocity[0], bearing.velocity[1]
    radial_x, radial_y = x / distance, y / distance
    approach = v_x * radial_x + v_y * radial_y
    normal = push(rotor, depth, approach)
    sliding = v_y * radial_x - v_x * radial_y + rotor.speed * rotor.journal_radius
    tangential = -rotor.friction * normal * min(max(sliding / _RUBBING_SPEED, -1.0), 1.0)
    bearing.contact_force[0] = -normal * radial_x - tangential * radial_y
    bearing.contact_force[1] = -normal * radial_y + tangential * radial_x


@numba.njit(inline="always", error_model="numpy")
def push(contact, depth, approach):
    """Force of a backup bearing along its normal: a spring and a damper that only push."""
    return max(contact.contact_stiffness * depth + contact.contact_damping * approach, 0.0)


@numba.njit(inline="always", error_model="numpy")
def moved(step, position, velocity, acceleration, previous):
    """Position and velocity after a step of one direction of motion."""
    after = velocity + step * (1.5 * acceleration - 0.5 * previous)
    return position + 0.5 * step * (velocity + after), after


@numba.njit(inline="always", error_model="numpy")
def move_point_mass(constants, state, bearing):
    """Move a point mass by one step."""
    h, rotor = constants.step, constants.rotor
    for axis in range(2):
        force = bearing.pull[axis] + bearing.contact_force[axis]
        acceleration = (force + state.external_force[axis] + state.unbalance_force[axis]) / rotor.mass
        if axis == 1:
            acceleration -= rotor.gravity
        else:
            acceleration *= rotor.free_x
        if not state.started:
            bearing.acceleration[axis] = acceleration
        bearing.position[axis], bearing.velocity[axis] = moved(
            h, bearing.position[axis], bearing.velocity[axis], acceleration, bearing.acceleration[axis]
        )
        bearing.acceleration[axis] = acceleration


@numba.njit(inline="always", error_model="numpy")
def move_modes(constants, state, bearings, modes):
    """Move a rotor with generalised coordinates by one step, and its journals with it."""
    h = constants.step
    _accelerate(state, bearings, modes)
    if not state.started:
        for n in range(modes.shape[1]):
            modes[PREVIOUS, n] = modes[ACCELERATION, n]
    for n in range(modes.shape[1]):
        modes[COORDINATE, n], modes[RATE, n] = moved(
            h, modes[COORDINATE, n], modes[RATE, n], modes[ACCELERATION, n], modes[PREVIOUS, n]
        )
        modes[PREVIOUS, n] = modes[ACCELERATION, n]
    place_journals(bearings, modes)


@numba.njit(inline="always", error_model="numpy")
def _accelerate(state, bearings, modes):
    """Accelerations of the coordinates; four running sums at a time become one vector register."""
    _gather_forces(state, bearings)
    size = modes.shape[1]
    rates = STIFFNESS + size
    first = 0
    while first + 4 <= size:
        a, b, c, d = modes[WEIGHT, first], modes[WEIGHT, first + 1], modes[WEIGHT, first + 2], modes[WEIGHT, first + 3]
        for m in range(size):
            a, b, c, d = _add_four(a, b, c, d, modes, STIFFNESS + m, first, modes[COORDINATE, m])
        for m in range(size):
            a, b, c, d = _add_four(a, b, c, d, modes, rates + m, first, modes[RATE, m])
        for m in range(FORCES):
            a, b, c, d = _add_four(a, b, c, d, modes, INPUTS + m, first, state.force[m])
        modes[ACCELERATION, first], modes[ACCELERATION, first + 1] = a, b
        modes[ACCELERATION, first + 2], modes[ACCELERATION, first + 3] = c, d
        first += 4
    for n in range(first, size):
        total = modes[WEIGHT, n]
        for m in range(size):
            total += modes[STIFFNESS + m, n] * modes[COORDINATE, m]
        for m in range(size):
            total += modes[rates + m, n] * modes[RATE, m]
        for m in range(FORCES):
            total += modes[INPUTS + m, n] * state.force[m]
        modes[ACCELERATION, n] = total


@numba.njit(inline="always", error_model="numpy")
def _gather_forces(state, bearings):
    """Forces in the order of the rows from INPUTS on."""
    for number in range(bearings.shape[0]):
        bearing = bearings[number]
        for axis in range(2):
            state.force[2 * number + axis] = bearing.pull[axis] + bearing.contact_force[axis]
    for axis in range(2):
        state.force[axis] += state.external_force[axis]
        state.force[UNBALANCE - INPUTS + axis] = state.unbalance_force[axis]


@numba.njit(inline="always", error_model="numpy")
def _add_four(a, b, c, d, modes, row, first, factor):
    """Add a multiple of four neighbours in a row to four sums."""
    return (
        a + modes[row, first] * factor,
        b + modes[row, first + 1] * factor,
        c + modes[row, first + 2] * factor,
        d + modes[row, first + 3] * factor,
    )


@numba.njit(cache=True, error_model="numpy")
def place_journals(bearings, modes):
    """Positions and velocities of the journals from the coordinates."""
    for number in range(bearings.shape[0]):
        bearing = bearings[number]
        for axis in range(2):
            row = POSITIONS + 2 * number + axis
            position, velocity = 0.0, 0.0
            for n in range(modes.shape[1]):
                position += modes[row, n] * modes[COORDINATE, n]
                velocity += modes[row, n] * modes[RATE, n]
            bearing.position[axis] = position
            bearing.velocity[axis] = velocity


@numba.njit(cache=True, error_model="numpy")
def sense(constants, state, bearings, modes):
    """What the sensors see, behind their low-pass; without one, exactly their displacement."""
    share = constants.sensor_share
    for number in range(bearings.shape[0]):
        bearing = bearings[number]
        for axis in range(2):
            place = 2 * number + axis
            position = bearing.position[axis]
            if modes.shape[1] > 0:
                position = 0.0
                for n in range(modes.shape[1]):
                    position += modes[SENSORS + place, n] * modes[COORDINATE, n]
            state.sensed[place] = share * position + (1.0 - share) * state.sensed[place]

"""Compiled parts of the integrator that move the rotor: point mass, modes, disturbances, backup bearings."""

from __future__ import annotations

import math

import numba

from amb_core.plant.kernel.layout import (
    ACCELERATION,
    BLOCK_SIZE,
    CONTACT_DAMPING,
    CONTACT_FORCE,
    CONTACT_STIFFNESS,
    FORCE_FREQUENCY,
    FORCE_X,
    FORCE_Y,
    FREE_X,
    FRICTION,
    GRAVITY,
    HEAD_SIZE,
    JOURNAL_RADIUS,
    MASS,
    MODE_INPUTS,
    MODE_POSITIONS,
    MODE_SENSORS,
    MODE_STIFFNESS,
    MODE_UNBALANCE,
    MODE_WEIGHT,
    POSITION,
    PULL,
    RADIUS,
    SENSED,
    SENSOR_LAG,
    SPEED,
    STARTED,
    STEP,
    STEPS,
    UNBALANCE,
    VELOCITY,
    WORK_SIZE,
)

_RUBBING_SPEED = 1e-3
"""Sliding speed (m/s) from which friction is fully there; below, it grows in proportion."""


@numba.njit(cache=True, error_model="numpy")
def set_disturbance(state, constants, force):
    """External force (2) at bearing A and force of the unbalance (2) at the present time (N) into `force`."""
    time = state[STEPS] * constants[STEP]
    wave = math.cos(constants[FORCE_FREQUENCY] * time)
    force[0] = constants[FORCE_X] * wave
    force[1] = constants[FORCE_Y] * wave
    turning = constants[UNBALANCE] * constants[SPEED] * constants[SPEED]
    force[2] = turning * math.cos(constants[SPEED] * time)
    force[3] = turning * math.sin(constants[SPEED] * time)


@numba.njit(cache=True, error_model="numpy")
def set_contact_force(state, constants, work, bearing):
    """Backup bearing: spring, damper that only pushes, and friction against the surface of the turning journal."""
    x, y = state[POSITION + 2 * bearing], state[POSITION + 2 * bearing + 1]
    target = bearing * WORK_SIZE + CONTACT_FORCE
    work[target] = 0.0
    work[target + 1] = 0.0
    distance = math.sqrt(x * x + y * y)
    depth = distance - constants[RADIUS]
    if depth <= 0.0:
        return
    v_x, v_y = state[VELOCITY + 2 * bearing], state[VELOCITY + 2 * bearing + 1]
    radial_x, radial_y = x / distance, y / distance
    approach = v_x * radial_x + v_y * radial_y
    normal = max(constants[CONTACT_STIFFNESS] * depth + constants[CONTACT_DAMPING] * approach, 0.0)
    sliding = v_y * radial_x - v_x * radial_y + constants[SPEED] * constants[JOURNAL_RADIUS]
    tangential = -constants[FRICTION] * normal * min(max(sliding / _RUBBING_SPEED, -1.0), 1.0)
    work[target] = -normal * radial_x - tangential * radial_y
    work[target + 1] = -normal * radial_y + tangential * radial_x


@numba.njit(inline="always", error_model="numpy")
def move_point_mass(state, constants, work, force):
    """Adams-Bashforth for the velocity, trapezoidal rule for the position; `force` (4) is that of the disturbances."""
    h = constants[STEP]
    for axis in range(2):
        acceleration = (work[PULL + axis] + work[CONTACT_FORCE + axis] + force[axis] + force[2 + axis]) / constants[
            MASS
        ]
        if axis == 1:
            acceleration -= constants[GRAVITY]
        else:
            acceleration *= constants[FREE_X]
        if state[STARTED] == 0.0:
            state[ACCELERATION + axis] = acceleration
        velocity = state[VELOCITY + axis]
        state[VELOCITY + axis] += h * (1.5 * acceleration - 0.5 * state[ACCELERATION + axis])
        state[POSITION + axis] += 0.5 * h * (velocity + state[VELOCITY + axis])
        state[ACCELERATION + axis] = acceleration


@numba.njit(cache=True, error_model="numpy")
def move_modes(state, constants, modes, work, force, bearings):
    """The same for a rotor with generalised coordinates, and what they make of the journals' positions."""
    h = constants[STEP]
    size = modes.shape[1]
    q = HEAD_SIZE + bearings * BLOCK_SIZE
    rate, previous = q + size, q + 2 * size
    acceleration = q + 3 * size
    for n in range(size):
        state[acceleration + n] = modes[MODE_WEIGHT, n]
    for m in range(size):
        for n in range(size):
            state[acceleration + n] += modes[MODE_STIFFNESS + m, n] * state[q + m]
    for m in range(size):
        for n in range(size):
            state[acceleration + n] += modes[MODE_STIFFNESS + size + m, n] * state[rate + m]
    for axis in range(4):
        source = (axis // 2) * WORK_SIZE + axis % 2
        pull = work[source + PULL] + work[source + CONTACT_FORCE]
        if axis < 2:
            pull += force[axis]
        for n in range(size):
            state[acceleration + n] += modes[MODE_INPUTS + axis, n] * pull
    for axis in range(2):
        for n in range(size):
            state[acceleration + n] += modes[MODE_UNBALANCE + axis, n] * force[2 + axis]
    if state[STARTED] == 0.0:
        for n in range(size):
            state[previous + n] = state[acceleration + n]
    for n in range(size):
        before = state[rate + n]
        state[rate + n] += h * (1.5 * state[acceleration + n] - 0.5 * state[previous + n])
        state[q + n] += 0.5 * h * (before + state[rate + n])
        state[previous + n] = state[acceleration + n]
    place_journals(state, modes, bearings)


@numba.njit(cache=True, error_model="numpy")
def place_journals(state, modes, bearings):
    """Positions and velocities of the journals from the coordinates."""
    size = modes.shape[1]
    q = HEAD_SIZE + bearings * BLOCK_SIZE
    for axis in range(4):
        position, velocity = 0.0, 0.0
        for n in range(size):
            position += modes[MODE_POSITIONS + axis, n] * state[q + n]
            velocity += modes[MODE_POSITIONS + axis, n] * state[q + size + n]
        state[POSITION + axis] = position
        state[VELOCITY + axis] = velocity


@numba.njit(cache=True, error_model="numpy")
def sense(state, constants, modes, bearings):
    """What the sensors see, behind their low-pass; without one, exactly their displacement."""
    lag = constants[SENSOR_LAG]
    size = modes.shape[1]
    q = HEAD_SIZE + bearings * BLOCK_SIZE
    for axis in range(2 * bearings):
        position = state[POSITION + axis]
        if size > 0:
            position = 0.0
            for n in range(size):
                position += modes[MODE_SENSORS + axis, n] * state[q + n]
        state[SENSED + axis] = lag * position + (1.0 - lag) * state[SENSED + axis]

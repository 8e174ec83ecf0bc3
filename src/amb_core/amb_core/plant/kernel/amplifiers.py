"""Compiled parts of the integrator for the amplifiers: current references, duty cycles, voltages, diodes."""

from __future__ import annotations

import numba

from amb_core.plant.kernel.layout import (
    APPLIED,
    BIAS,
    CARRIER_SHIFT,
    CURRENT,
    CURRENT_MAX,
    CURRENT_MIN,
    CURRENT_START,
    CURRENT_SUM,
    DEAD_TIME,
    DUTY,
    DUTY_MAX,
    DUTY_MIN,
    INTEGRAL,
    KI,
    KP,
    PERIOD,
    RATES,
    REFERENCE,
    SOLUTION,
    STEP,
    SUPPLY,
    VOLTAGE,
)
from amb_core.plant.network import COILS, POLES


@numba.njit(inline="always", error_model="numpy")
def set_references(constants, work, scratch, current_x, current_y):
    """Coil current references from the control current references of a bearing."""
    for coil in range(COILS):
        current = current_x if coil % 2 == 0 else current_y
        reference = constants[BIAS] + (current if coil < 2 else -current)
        work[scratch + REFERENCE + coil] = min(max(reference, constants[CURRENT_MIN]), constants[CURRENT_MAX])


@numba.njit(inline="always", error_model="numpy")
def update_duty(state, constants, work, block, scratch, coil):
    """PI on the mean current of the past switching period; the integral part holds while the duty is at its limit."""
    period = constants[PERIOD]
    # Trapezoidal mean: the sum counts the start of every step, so half the change over the period is missing.
    current = work[scratch + CURRENT + coil]
    missing = 0.5 * (current - state[block + CURRENT_START + coil])
    error = work[scratch + REFERENCE + coil] - (state[block + CURRENT_SUM + coil] + missing) / period
    integral = state[block + INTEGRAL + coil] + constants[KI] * error * period * constants[STEP]
    duty = 0.5 + constants[KP] * error + integral
    if constants[DUTY_MIN] <= duty <= constants[DUTY_MAX]:
        state[block + INTEGRAL + coil] = integral
    state[block + DUTY + coil] = min(max(duty, constants[DUTY_MIN]), constants[DUTY_MAX])
    state[block + CURRENT_SUM + coil] = 0.0
    state[block + CURRENT_START + coil] = current


@numba.njit(inline="always", error_model="numpy")
def set_voltages(state, constants, work, block, scratch, phase):
    """Mean coil voltages over this internal step; the pulse is centred in the switching period, which is common."""
    if phase == 0:
        for coil in range(COILS):
            update_duty(state, constants, work, block, scratch, coil)
    period = constants[PERIOD]
    for coil in range(COILS):
        half = 0.5 * period * state[block + DUTY + coil]
        on = min(phase + 1.0, 0.5 * period + half) - max(float(phase), 0.5 * period - half)
        work[scratch + VOLTAGE + coil] = constants[SUPPLY] * (2.0 * min(max(on, 0.0), 1.0) - 1.0)


@numba.njit(cache=True, error_model="numpy")
def set_shifted_voltages(state, constants, work, block, scratch, phase):
    """The same for carriers that follow one another, with dead time, or without limits.

    Dead time delays the edge that drives a current further: until then it flows through the diodes.
    """
    period, shift = int(constants[PERIOD]), int(constants[CARRIER_SHIFT])
    for coil in range(COILS):
        if phase == coil * shift:
            update_duty(state, constants, work, block, scratch, coil)
    for coil in range(COILS):
        dead = constants[DEAD_TIME]
        driven = work[scratch + CURRENT + coil] >= 0.0
        if period == 1:  # a switching period of one internal step has the average voltage, which may have no limit
            duty = state[block + DUTY + coil] - (dead if driven else -dead)
            work[scratch + VOLTAGE + coil] = constants[SUPPLY] * (2.0 * duty - 1.0)
            continue
        now = phase - coil * shift
        if now < 0:
            now += period
        half = 0.5 * period * state[block + DUTY + coil]
        start, end = 0.5 * period - half, 0.5 * period + half
        if driven:
            start += dead
        else:
            end += dead
        on = min(now + 1.0, end) - max(float(now), start)
        work[scratch + VOLTAGE + coil] = constants[SUPPLY] * (2.0 * min(max(on, 0.0), 1.0) - 1.0)


@numba.njit(inline="always", error_model="numpy")
def any_negative_current(work, scratch):
    """Whether a coil current of a bearing is negative."""
    first = scratch + CURRENT
    return work[first] < 0.0 or work[first + 1] < 0.0 or work[first + 2] < 0.0 or work[first + 3] < 0.0


@numba.njit(cache=True, error_model="numpy")
def block_negative_currents(matrices, work, scratch):
    """Diodes: where the current would be negative the coil voltage rises until it is zero (projected Gauss-Seidel)."""
    for coil in range(COILS):
        work[scratch + APPLIED + coil] = work[scratch + VOLTAGE + coil]
    for _ in range(20):
        largest = 0.0
        for coil in range(COILS):
            column = SOLUTION + POLES + coil
            own = matrices[column, POLES + coil]
            if own == 0.0:
                continue  # no amplifier, no current
            voltage = scratch + VOLTAGE + coil
            wanted = work[voltage] - work[scratch + CURRENT + coil] / own
            change = max(wanted, work[scratch + APPLIED + coil]) - work[voltage]
            if change != 0.0:
                work[voltage] += change
                for j in range(POLES + COILS):
                    work[scratch + RATES + j] += matrices[column, j] * change
                largest = max(largest, abs(change))
        if largest < 1e-9:
            return

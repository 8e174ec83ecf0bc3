"""Compiled parts of the integrator for the amplifiers: current references, duty cycles, voltages, diodes.

Once per switching period of n steps h, a PI controller sets the duty cycle d of a coil from the mean current of the
period before, with reference i_r:

    e = i_r - mean(i),    I <- I + K_I e n h,    d = 1/2 + K_P e + I,    V = U (2 s - 1)

s is the share of the step in which the pulse is on: n d steps wide, in the middle of the period. I holds while d is at
its limit.
"""

from __future__ import annotations

import numba

from amb_core.plant.network import COILS


@numba.njit(inline="always", error_model="numpy")
def set_references(amplifier, bearing, current_x, current_y):
    """Coil current references from the control current references of a bearing."""
    for coil in range(COILS):
        current = current_x if coil % 2 == 0 else current_y
        bearing.reference[coil] = coil_reference(amplifier, current if coil < 2 else -current)


@numba.njit(inline="always", error_model="numpy")
def coil_reference(amplifier, current):
    """Reference of a coil current for a control current reference towards the coil, limited."""
    return min(max(amplifier.bias + current, amplifier.current_min), amplifier.current_max)


@numba.njit(inline="always", error_model="numpy")
def regulate(amplifier, error, integral, step):
    """Duty cycle and integral part of the PI controller for an error of the mean current (A), limited."""
    wanted = integral + amplifier.integral_gain * error * float(amplifier.period) * step
    duty = 0.5 + amplifier.proportional_gain * error + wanted
    held = not amplifier.duty_min <= duty <= amplifier.duty_max
    return min(max(duty, amplifier.duty_min), amplifier.duty_max), integral if held else wanted


@numba.njit(inline="always", error_model="numpy")
def update_duty(amplifier, bearing, coil, step):
    """Duty cycle of a coil for the switching period that begins."""
    # Trapezoidal mean: the sum counts the start of every step, so half the change over the period is missing; nothing
    # is missing where the currents are means over the steps.
    current = bearing.current[coil]
    missing = amplifier.mean_by_ends * (current - bearing.current_start[coil])
    mean = (bearing.current_sum[coil] + missing) / float(amplifier.period)
    duty, integral = regulate(amplifier, bearing.reference[coil] - mean, bearing.integral[coil], step)
    bearing.duty[coil], bearing.integral[coil] = duty, integral
    bearing.current_sum[coil] = 0.0
    bearing.current_start[coil] = current


@numba.njit(inline="always", error_model="numpy")
def set_voltages(amplifier, bearing, phase, step):
    """Mean coil voltages over this internal step; the pulse is centred in the switching period, which is common."""
    if phase == 0:
        for coil in range(COILS):
            update_duty(amplifier, bearing, coil, step)
    period = float(amplifier.period)
    for coil in range(COILS):
        half = 0.5 * period * bearing.duty[coil]
        on = min(phase + 1.0, 0.5 * period + half) - max(float(phase), 0.5 * period - half)
        bearing.voltage[coil] = amplifier.supply * (2.0 * min(max(on, 0.0), 1.0) - 1.0)


@numba.njit(cache=True, error_model="numpy")
def set_shifted_voltages(amplifier, bearing, phase, step):
    """The same for carriers that follow one another, with dead time, or without limits."""
    for coil in range(COILS):
        if phase == coil * amplifier.carrier_shift:
            update_duty(amplifier, bearing, coil, step)
    for coil in range(COILS):
        now = phase - coil * amplifier.carrier_shift
        if now < 0:
            now += amplifier.period
        bearing.voltage[coil] = delayed_voltage(amplifier, bearing.duty[coil], bearing.current[coil], now)


@numba.njit(inline="always", error_model="numpy")
def delayed_voltage(amplifier, duty, current, now):
    """Mean voltage of a coil over the internal step at place `now` of its switching period.

    Dead time delays the edge that drives a current further: until then it flows through the diodes.
    """
    period, dead = amplifier.period, amplifier.dead_time
    driven = current >= 0.0
    if period == 1:  # a switching period of one internal step has the average voltage, which may have no limit
        share = duty - (dead if driven else -dead)
    else:
        half = 0.5 * period * duty
        start, end = 0.5 * period - half, 0.5 * period + half
        if driven:
            start += dead
        else:
            end += dead
        share = min(max(min(now + 1.0, end) - max(float(now), start), 0.0), 1.0)
    return amplifier.supply * (2.0 * share - 1.0)


@numba.njit(inline="always", error_model="numpy")
def count_step(constants, state):
    """Count an internal step, and its place in the switching period."""
    state.started = True
    state.steps += 1
    state.phase = state.phase + 1 if state.phase + 1 < constants.amplifier.period else 0


@numba.njit(inline="always", error_model="numpy")
def any_negative_current(bearing):
    """Whether a coil current of a bearing is negative."""
    current = bearing.current
    return current[0] < 0.0 or current[1] < 0.0 or current[2] < 0.0 or current[3] < 0.0


@numba.njit(cache=True, error_model="numpy")
def block_negative_currents(constants, bearing):
    """Diodes: where the current would be negative the coil voltage rises until it is zero (projected Gauss-Seidel)."""
    for coil in range(COILS):
        bearing.applied_voltage[coil] = bearing.voltage[coil]
    for _ in range(20):
        largest = 0.0
        for coil in range(COILS):
            own = constants.current_by_voltage[coil, coil]
            if own == 0.0:
                continue  # no amplifier, no current
            wanted = bearing.voltage[coil] - bearing.current[coil] / own
            change = max(wanted, bearing.applied_voltage[coil]) - bearing.voltage[coil]
            if change != 0.0:
                bearing.voltage[coil] += change
                for j in range(bearing.rate.size):
                    bearing.rate[j] += constants.rate_by_voltage[coil, j] * change
                for other in range(COILS):
                    bearing.current[other] += constants.current_by_voltage[coil, other] * change
                largest = max(largest, abs(change))
        if largest < 1e-9:
            return

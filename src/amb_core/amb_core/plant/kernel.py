"""The integrator of the plant: compiled, on plain arrays, strict IEEE arithmetic.

One internal step of length h advances fluxes and rotor by the second-order Adams-Bashforth method; the coil voltages
enter with their exact mean over the step, so the volt-seconds of every switching instant are right wherever in the
step it falls. No fast-math: the same samples come out wherever the kernel is called from.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.plant.network import COILS, POLES

# State vector
FLUX = 0  # pole fluxes (Wb)
MMF = 8  # magnetomotive force drops along the poles at the previous internal step (A)
X, Y, VX, VY = 16, 17, 18, 19  # rotor position (m) and velocity (m/s)
AX, AY = 20, 21  # acceleration at the previous internal step (m/s^2)
INTEGRAL = 22  # integral parts of the amplifiers' PI (duty)
CURRENT_SUM = 26  # sums of the coil currents over the switching period (A)
DUTY = 30  # duty cycles (-)
CURRENT_START = 34  # coil currents without the voltages' direct part at the start of the switching period (A)
PHASE = 38  # internal step within the switching period (-)
STARTED = 39  # 0 before the first internal step
STATE_SIZE = 40

# Constants vector
STEP, GAP, GAP_RELUCTANCE, FORCE, MASS, GRAVITY, RADIUS = range(7)
SUPPLY, DUTY_MIN, DUTY_MAX, KP, KI, BIAS, CURRENT_MAX, PERIOD, UNIPOLAR = range(7, 16)
CONSTANTS_SIZE = 16

# Rows of the matrices array, shape (22, 12)
RELUCTANCE = 0  # columns of the iron reluctance matrix (8)
SOLUTION = 8  # columns of the network's solution (12): each maps one of (h, V) to (dphi/dt, i)
COSINE, SINE = 20, 21  # directions of the poles
MATRICES_SIZE = 22

# Work array
_EXTRAPOLATED, _RATES, _CURRENT, _VOLTAGE, _REFERENCE, _APPLIED, _FORCE = 8, 16, 24, 28, 32, 36, 40
WORK_SIZE = 42

# Columns of a trace row, one row per internal step: flux, flux rate, current, voltage, x, y, vx, vy, force x, y
TRACE_FLUX, TRACE_RATE, TRACE_CURRENT, TRACE_VOLTAGE, TRACE_ROTOR, TRACE_FORCE, TRACE_SIZE = 0, 8, 16, 20, 24, 28, 30

OK, DELEVITATED, NOT_FINITE, INPUT_NOT_FINITE = 0, 1, 2, 3


@numba.njit(cache=True, error_model="numpy")
def advance(
    state: NDArray[np.float64],
    constants: NDArray[np.float64],
    matrices: NDArray[np.float64],
    work: NDArray[np.float64],
    current_x: float,
    current_y: float,
    steps: int,
    trace: NDArray[np.float64],
) -> int:
    """Advance the plant by `steps` internal steps with the control current references held.

    Parameters
    ----------
    state : ndarray, shape (40,)
        State vector, changed in place.
    constants : ndarray, shape (16,)
        Scalars of the plant.
    matrices : ndarray, shape (22, 12)
        Constant matrices of the magnetic network.
    work : ndarray, shape (42,)
        Scratch.
    current_x, current_y : float
        Control current references (A).
    steps : int
        Internal steps.
    trace : ndarray, shape (steps, 30) or (0, 30)
        Receives the variables at the start of every internal step if it has rows.

    Returns
    -------
    int
        OK, DELEVITATED (the rotor touched the backup bearing), NOT_FINITE, or INPUT_NOT_FINITE (nothing done).
    """
    if not math.isfinite(current_x + current_y):
        return INPUT_NOT_FINITE
    period = int(constants[PERIOD])
    phase = int(state[PHASE])
    _set_references(constants, work, current_x, current_y)
    for n in range(steps):
        _set_drops(state, constants, matrices, work)
        if phase == 0:
            _update_duties(state, constants, work)
        _set_voltages(state, constants, work, phase)
        _set_rates(matrices, work)
        if constants[UNIPOLAR] != 0.0 and _any_negative_current(work):
            _block_negative_currents(matrices, work)
        _set_force(state, constants, matrices, work)
        if trace.shape[0] > 0:
            _write_trace(state, matrices, work, trace[n])
        _integrate(state, constants, work)
        phase += 1
        if phase == period:
            phase = 0
    state[PHASE] = phase
    square = state[X] * state[X] + state[Y] * state[Y]
    if not math.isfinite(square):
        return NOT_FINITE
    return DELEVITATED if square >= constants[RADIUS] * constants[RADIUS] else OK


@numba.njit(inline="always", error_model="numpy")
def _set_references(constants, work, current_x, current_y):
    for coil in range(COILS):
        current = current_x if coil % 2 == 0 else current_y
        reference = constants[BIAS] + (current if coil < 2 else -current)
        work[_REFERENCE + coil] = min(max(reference, 0.0), constants[CURRENT_MAX])


@numba.njit(inline="always", error_model="numpy")
def _update_duties(state, constants, work):
    """PI on the mean current of the past switching period; the integral part holds while the duty is at its limit."""
    period = constants[PERIOD]
    for coil in range(COILS):
        # Trapezoidal mean: the sum counts the start of every step, so half the change over the period is missing.
        missing = 0.5 * (work[_CURRENT + coil] - state[CURRENT_START + coil])
        error = work[_REFERENCE + coil] - (state[CURRENT_SUM + coil] + missing) / period
        integral = state[INTEGRAL + coil] + constants[KI] * error * period * constants[STEP]
        duty = 0.5 + constants[KP] * error + integral
        if constants[DUTY_MIN] <= duty <= constants[DUTY_MAX]:
            state[INTEGRAL + coil] = integral
        state[DUTY + coil] = min(max(duty, constants[DUTY_MIN]), constants[DUTY_MAX])
        state[CURRENT_SUM + coil] = 0.0
        state[CURRENT_START + coil] = work[_CURRENT + coil]


@numba.njit(inline="always", error_model="numpy")
def _set_voltages(state, constants, work, phase):
    """Mean coil voltage over this internal step; the pulse is centred in the switching period."""
    period = constants[PERIOD]
    for coil in range(COILS):
        half = 0.5 * period * state[DUTY + coil]
        on = min(phase + 1.0, 0.5 * period + half) - max(float(phase), 0.5 * period - half)
        work[_VOLTAGE + coil] = constants[SUPPLY] * (2.0 * min(max(on, 0.0), 1.0) - 1.0)


@numba.njit(inline="always", error_model="numpy")
def _set_drops(state, constants, matrices, work):
    """Magnetomotive force drops along the poles, and what the coil currents owe to them."""
    for j in range(POLES):
        gap = constants[GAP] - state[X] * matrices[COSINE, j] - state[Y] * matrices[SINE, j]
        work[j] = gap * constants[GAP_RELUCTANCE] * state[FLUX + j]
    for j in range(0, POLES, 4):
        _accumulate(matrices, RELUCTANCE, POLES, j, state, FLUX, work, j)
    if state[STARTED] == 0.0:
        for j in range(POLES):
            state[MMF + j] = work[j]
    for j in range(POLES):
        work[_EXTRAPOLATED + j] = 1.5 * work[j] - 0.5 * state[MMF + j]
        state[MMF + j] = work[j]
    for coil in range(COILS):
        work[_CURRENT + coil] = 0.0
    _accumulate(matrices, SOLUTION, POLES, POLES, work, 0, work, _CURRENT)


@numba.njit(inline="always", error_model="numpy")
def _set_rates(matrices, work):
    """Flux rates from the extrapolated drops and the voltages, and the voltages' part of the coil currents."""
    for j in range(POLES):
        work[_RATES + j] = 0.0
    for j in range(0, POLES, 4):
        _accumulate(matrices, SOLUTION, POLES, j, work, _EXTRAPOLATED, work, _RATES + j)
        _accumulate(matrices, SOLUTION + POLES, COILS, j, work, _VOLTAGE, work, _RATES + j)
    _accumulate(matrices, SOLUTION + POLES, COILS, POLES, work, _VOLTAGE, work, _CURRENT)


@numba.njit(inline="always", error_model="numpy")
def _accumulate(matrices, row, rows, column, vector, start, result, target):
    """Add four components of a matrix-vector product; four running sums become one vector register."""
    a, b, c, d = result[target], result[target + 1], result[target + 2], result[target + 3]
    for n in range(rows):
        factor = vector[start + n]
        a += matrices[row + n, column] * factor
        b += matrices[row + n, column + 1] * factor
        c += matrices[row + n, column + 2] * factor
        d += matrices[row + n, column + 3] * factor
    result[target], result[target + 1], result[target + 2], result[target + 3] = a, b, c, d


@numba.njit(inline="always", error_model="numpy")
def _any_negative_current(work):
    return work[_CURRENT] < 0.0 or work[_CURRENT + 1] < 0.0 or work[_CURRENT + 2] < 0.0 or work[_CURRENT + 3] < 0.0


@numba.njit(cache=True, error_model="numpy")
def _block_negative_currents(matrices, work):
    """Diodes: where the current would be negative the coil voltage rises until it is zero (projected Gauss-Seidel)."""
    for coil in range(COILS):
        work[_APPLIED + coil] = work[_VOLTAGE + coil]
    for _ in range(20):
        largest = 0.0
        for coil in range(COILS):
            column = SOLUTION + POLES + coil
            wanted = work[_VOLTAGE + coil] - work[_CURRENT + coil] / matrices[column, POLES + coil]
            change = max(wanted, work[_APPLIED + coil]) - work[_VOLTAGE + coil]
            if change != 0.0:
                work[_VOLTAGE + coil] += change
                for j in range(POLES + COILS):
                    work[_RATES + j] += matrices[column, j] * change
                largest = max(largest, abs(change))
        if largest < 1e-9:
            return


@numba.njit(inline="always", error_model="numpy")
def _set_force(state, constants, matrices, work):
    force_x = 0.0
    force_y = 0.0
    for j in range(POLES):
        pull = constants[FORCE] * state[FLUX + j] * state[FLUX + j]
        force_x += pull * matrices[COSINE, j]
        force_y += pull * matrices[SINE, j]
    work[_FORCE] = force_x
    work[_FORCE + 1] = force_y


@numba.njit(inline="always", error_model="numpy")
def _integrate(state, constants, work):
    h = constants[STEP]
    for j in range(POLES):
        state[FLUX + j] += h * work[_RATES + j]
    for coil in range(COILS):
        state[CURRENT_SUM + coil] += work[_CURRENT + coil]
    for axis in range(2):
        acceleration = work[_FORCE + axis] / constants[MASS]
        if axis == 1:
            acceleration -= constants[GRAVITY]
        if state[STARTED] == 0.0:
            state[AX + axis] = acceleration
        velocity = state[VX + axis]
        state[VX + axis] += h * (1.5 * acceleration - 0.5 * state[AX + axis])
        state[X + axis] += 0.5 * h * (velocity + state[VX + axis])
        state[AX + axis] = acceleration
    state[STARTED] = 1.0


@numba.njit(cache=True, error_model="numpy")
def _write_trace(state, matrices, work, row):
    for j in range(POLES):
        row[TRACE_FLUX + j] = state[FLUX + j]
        rate = 0.0
        for column in range(POLES):
            rate += matrices[SOLUTION + column, j] * work[column]
        for coil in range(COILS):
            rate += matrices[SOLUTION + POLES + coil, j] * work[_VOLTAGE + coil]
        row[TRACE_RATE + j] = rate
    for coil in range(COILS):
        row[TRACE_CURRENT + coil] = work[_CURRENT + coil]
        row[TRACE_VOLTAGE + coil] = work[_VOLTAGE + coil]
    for n in range(4):
        row[TRACE_ROTOR + n] = state[X + n]
    for axis in range(2):
        row[TRACE_FORCE + axis] = work[_FORCE + axis]

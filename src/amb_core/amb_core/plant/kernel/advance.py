"""The integrator of the plant: compiled, on plain arrays, strict IEEE arithmetic.

One internal step of length h advances fluxes and rotor by the second-order Adams-Bashforth method; the coil voltages
enter with their exact mean over the step, so the volt-seconds of every switching instant are right wherever in the
step it falls. No fast-math: the same samples come out wherever the kernel is called from.

What the paper's table leaves out (nonlinear iron, solid journals, modes of the rotor, contact) stands in modules of its
own; the paper's plant has a loop without it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from amb_core.plant.kernel.amplifiers import (
    any_negative_current,
    block_negative_currents,
    set_references,
    set_shifted_voltages,
    set_voltages,
)
from amb_core.plant.kernel.iron_paths import add_diffusion_drops, add_iron_drops, set_energies
from amb_core.plant.kernel.layout import (
    BLOCK_SIZE,
    CONTACT,
    CONTACT_FORCE,
    COSINE,
    CURRENT,
    CURRENT_SUM,
    DELEVITATED,
    DISTURBED,
    EXTENDED,
    EXTRAPOLATED,
    FLUX,
    FORCE,
    GAP,
    GAP_CLOSED,
    GAP_RELUCTANCE,
    HEAD_SIZE,
    LINEAR_IRON,
    MMF,
    NONLINEAR_IRON,
    NOT_FINITE,
    OK,
    PERIOD,
    PHASE,
    PLAIN_CARRIERS,
    POSITION,
    PULL,
    QUASISTATIC,
    RADIUS,
    RATES,
    RELUCTANCE,
    SENSOR_LAG,
    SINE,
    SOLID_JOURNAL,
    SOLUTION,
    STARTED,
    STEP,
    STEPS,
    TRACE_BLOCK_SIZE,
    TRACE_CONTACT,
    TRACE_CURRENT,
    TRACE_FLUX,
    TRACE_FORCE,
    TRACE_POSITION,
    TRACE_RATE,
    TRACE_TAIL_SIZE,
    TRACE_VELOCITY,
    TRACE_VOLTAGE,
    UNIPOLAR,
    VELOCITY,
    VOLTAGE,
    WORK_SIZE,
)
from amb_core.plant.kernel.pointers import matrix, stack, vector
from amb_core.plant.kernel.products import accumulate
from amb_core.plant.kernel.quasistatic import balance_fluxes
from amb_core.plant.kernel.rotor import move_modes, move_point_mass, sense, set_contact_force, set_disturbance
from amb_core.plant.kernel.stiff_iron import finish_iron_step
from amb_core.plant.network import COILS, POLES


class Arrays(NamedTuple):
    """The plant as arrays, made by `amb_core.plant.packing` and laid out as in `amb_core.plant.kernel.layout`.

    Attributes
    ----------
    state : ndarray, shape (n,)
        State vector, changed by every step.
    constants, matrices : ndarray, shapes (41,), (22, 12)
        Scalars of the plant, constant matrices of the magnetic network.
    work : ndarray, shape (bearings * 48,)
        Scratch; keeps the last currents and forces.
    iron : ndarray, shape (bearings, m, 24)
        State of the nonlinear iron; no bearings for linear iron.
    material, curve, paths : ndarray
        Constants of the nonlinear iron, see `amb_core.plant.iron` and `iron_paths`.
    diffusion : ndarray, shape (bearings, terms + 2, 10)
        State and coefficients of the diffusion into solid journals; no bearings without.
    quasistatic : ndarray
        Directions in which the fluxes settle without eddy currents, see `kernel.quasistatic`; empty with them.
    modes : ndarray, shape (15 + 2 n, n)
        The rotor's modes; shape (0, 0) for a point mass.
    force : ndarray, shape (4,)
        Forces of the disturbances (N): external x, y, unbalance x, y.
    """

    state: NDArray[np.float64]
    constants: NDArray[np.float64]
    matrices: NDArray[np.float64]
    work: NDArray[np.float64]
    iron: NDArray[np.float64]
    material: NDArray[np.float64]
    curve: NDArray[np.float64]
    paths: NDArray[np.float64]
    diffusion: NDArray[np.float64]
    quasistatic: NDArray[np.float64]
    modes: NDArray[np.float64]
    force: NDArray[np.float64]


@numba.njit(cache=True, error_model="numpy")
def advance(table: NDArray[np.int64], references: NDArray[np.float64], steps: int, trace: NDArray[np.float64]) -> int:
    """Advance the plant by `steps` internal steps with the control current references held.

    Parameters
    ----------
    table : ndarray, shape (12, 4)
        `address_table` of the plant's `Arrays`; their state is changed in place.
    references : ndarray, shape (2 * bearings,)
        Control current references x, y of each bearing (A), finite.
    steps : int
        Internal steps.
    trace : ndarray, shape (steps, m) or (0, m)
        Receives the variables at the start of every internal step if it has rows.

    Returns
    -------
    int
        OK, DELEVITATED (a journal touched its backup bearing), NOT_FINITE, or GAP_CLOSED (a journal reached the poles
        in spite of the backup bearing).
    """
    # In the order of `Arrays`
    state, constants, matrices, work = vector(table, 0), vector(table, 1), matrix(table, 2), vector(table, 3)
    iron, material, curve, paths = stack(table, 4), vector(table, 5), matrix(table, 6), matrix(table, 7)
    diffusion, quasistatic, modes, force = stack(table, 8), matrix(table, 9), matrix(table, 10), vector(table, 11)
    bearings = references.shape[0] // 2
    period = int(constants[PERIOD])
    phase = int(state[PHASE])
    for bearing in range(bearings):
        set_references(constants, work, bearing * WORK_SIZE, references[2 * bearing], references[2 * bearing + 1])
    if bearings == 1 and trace.shape[0] == 0 and constants[EXTENDED] == 0.0:
        # The paper's plant has a loop of its own, out of which the compiler leaves the rest.
        for _ in range(steps):
            _step_circuit(
                state, constants, matrices, work, iron, material, curve, paths, diffusion, quasistatic, 0, phase, False
            )
            _integrate_circuit(state, constants, work, HEAD_SIZE, 0)
            move_point_mass(state, constants, work, force)
            phase = _count_step(state, phase, period)
    else:
        for n in range(steps):
            # With its offsets known to the compiler, the first bearing takes less time.
            _step_circuit(
                state, constants, matrices, work, iron, material, curve, paths, diffusion, quasistatic, 0, phase, True
            )
            if bearings == 2:
                _step_other_circuit(
                    state, constants, matrices, work, iron, material, curve, paths, diffusion, quasistatic, 1, phase
                )
            if constants[DISTURBED] != 0.0:
                set_disturbance(state, constants, force)
            if trace.shape[0] > 0:
                _write_trace(state, matrices, work, bearings, modes.shape[1], trace[n])
                set_energies(iron, diffusion, paths, trace[n, bearings * TRACE_BLOCK_SIZE :])
            _integrate_circuit(state, constants, work, HEAD_SIZE, 0)
            if bearings == 2:
                _integrate_circuit(state, constants, work, HEAD_SIZE + BLOCK_SIZE, WORK_SIZE)
            if modes.shape[0] == 0:
                move_point_mass(state, constants, work, force)
            else:
                move_modes(state, constants, modes, work, force, bearings)
            if constants[SENSOR_LAG] != 1.0:
                sense(state, constants, modes, bearings)
            phase = _count_step(state, phase, period)
    state[PHASE] = phase
    if constants[SENSOR_LAG] == 1.0:
        sense(state, constants, modes, bearings)
    return _status(state, constants, bearings)


@numba.njit(inline="always", error_model="numpy")
def _count_step(state, phase, period):
    state[STARTED] = 1.0
    state[STEPS] += 1.0
    return phase + 1 if phase + 1 < period else 0


@numba.njit(inline="always", error_model="numpy")
def _step_circuit(
    state, constants, matrices, work, iron, material, curve, paths, diffusion, quasistatic, bearing, phase, extended
):
    """Amplifiers and fluxes of a bearing over one internal step, and its forces at the start of the step.

    Without `extended`, those of the paper's table.
    """
    block, scratch = HEAD_SIZE + bearing * BLOCK_SIZE, bearing * WORK_SIZE
    if extended and constants[QUASISTATIC] != 0.0:
        balance_fluxes(
            state, block, POSITION + 2 * bearing, constants, matrices, iron[bearing], paths, quasistatic, work, scratch
        )
    _set_gap_drops(state, constants, matrices, work, block, scratch, POSITION + 2 * bearing, extended)
    if extended and constants[NONLINEAR_IRON] != 0.0:
        add_iron_drops(state, block, constants, iron[bearing], material, curve, paths, work, scratch)
    if extended and constants[SOLID_JOURNAL] != 0.0:
        add_diffusion_drops(state, block, diffusion[bearing], paths, work, scratch)
    _extrapolate_drops(state, matrices, work, block, scratch)
    if not extended or constants[PLAIN_CARRIERS] != 0.0:
        set_voltages(state, constants, work, block, scratch, phase)
    else:
        set_shifted_voltages(state, constants, work, block, scratch, phase)
    _set_rates(matrices, work, scratch)
    if constants[UNIPOLAR] != 0.0 and any_negative_current(work, scratch):
        block_negative_currents(matrices, work, scratch)
    if extended and constants[NONLINEAR_IRON] != 0.0 and constants[QUASISTATIC] == 0.0:
        finish_iron_step(state, POSITION + 2 * bearing, constants, matrices, iron[bearing], paths, work, scratch)
    _set_pull(state, constants, matrices, work, block, scratch)
    if extended and constants[CONTACT] != 0.0:
        set_contact_force(state, constants, work, bearing)


@numba.njit(cache=True, error_model="numpy")
def _step_other_circuit(
    state, constants, matrices, work, iron, material, curve, paths, diffusion, quasistatic, bearing, phase
):
    _step_circuit(
        state, constants, matrices, work, iron, material, curve, paths, diffusion, quasistatic, bearing, phase, True
    )


@numba.njit(inline="always", error_model="numpy")
def _set_gap_drops(state, constants, matrices, work, block, scratch, position, extended):
    """Magnetomotive force drops along the gaps and the linear iron of the poles."""
    x, y = state[position], state[position + 1]
    for j in range(POLES):
        gap = constants[GAP] - x * matrices[COSINE, j] - y * matrices[SINE, j]
        work[scratch + j] = gap * constants[GAP_RELUCTANCE] * state[block + FLUX + j]
    if not extended or constants[LINEAR_IRON] != 0.0:
        for j in range(0, POLES, 4):
            accumulate(matrices, RELUCTANCE, POLES, j, state, block + FLUX, work, scratch + j)


@numba.njit(inline="always", error_model="numpy")
def _extrapolate_drops(state, matrices, work, block, scratch):
    """Drops in the middle of the step, and what the coil currents owe to those at its start."""
    if state[STARTED] == 0.0:
        for j in range(POLES):
            state[block + MMF + j] = work[scratch + j]
    for j in range(POLES):
        work[scratch + EXTRAPOLATED + j] = 1.5 * work[scratch + j] - 0.5 * state[block + MMF + j]
        state[block + MMF + j] = work[scratch + j]
    for coil in range(COILS):
        work[scratch + CURRENT + coil] = 0.0
    accumulate(matrices, SOLUTION, POLES, POLES, work, scratch, work, scratch + CURRENT)


@numba.njit(inline="always", error_model="numpy")
def _set_rates(matrices, work, scratch):
    """Flux rates from the extrapolated drops and the voltages, and the voltages' part of the coil currents."""
    for j in range(POLES):
        work[scratch + RATES + j] = 0.0
    for j in range(0, POLES, 4):
        accumulate(matrices, SOLUTION, POLES, j, work, scratch + EXTRAPOLATED, work, scratch + RATES + j)
        accumulate(matrices, SOLUTION + POLES, COILS, j, work, scratch + VOLTAGE, work, scratch + RATES + j)
    accumulate(matrices, SOLUTION + POLES, COILS, POLES, work, scratch + VOLTAGE, work, scratch + CURRENT)


@numba.njit(inline="always", error_model="numpy")
def _set_pull(state, constants, matrices, work, block, scratch):
    pull_x = 0.0
    pull_y = 0.0
    for j in range(POLES):
        pull = constants[FORCE] * state[block + FLUX + j] * state[block + FLUX + j]
        pull_x += pull * matrices[COSINE, j]
        pull_y += pull * matrices[SINE, j]
    work[scratch + PULL] = pull_x
    work[scratch + PULL + 1] = pull_y


@numba.njit(inline="always", error_model="numpy")
def _integrate_circuit(state, constants, work, block, scratch):
    h = constants[STEP]
    for j in range(POLES):
        state[block + FLUX + j] += h * work[scratch + RATES + j]
    for coil in range(COILS):
        state[block + CURRENT_SUM + coil] += work[scratch + CURRENT + coil]


@numba.njit(cache=True, error_model="numpy")
def _status(state, constants, bearings):
    largest = 0.0
    for bearing in range(bearings):
        x, y = state[POSITION + 2 * bearing], state[POSITION + 2 * bearing + 1]
        square = x * x + y * y
        if not math.isfinite(square):
            return NOT_FINITE
        largest = max(largest, square)
    if constants[CONTACT] != 0.0:
        return GAP_CLOSED if largest >= constants[GAP] * constants[GAP] else OK
    return DELEVITATED if largest >= constants[RADIUS] * constants[RADIUS] else OK


@numba.njit(cache=True, error_model="numpy")
def _write_trace(state, matrices, work, bearings, size, row):
    for bearing in range(bearings):
        block, scratch, target = HEAD_SIZE + bearing * BLOCK_SIZE, bearing * WORK_SIZE, bearing * TRACE_BLOCK_SIZE
        for j in range(POLES):
            row[target + TRACE_FLUX + j] = state[block + FLUX + j]
            rate = 0.0
            for column in range(POLES):
                rate += matrices[SOLUTION + column, j] * work[scratch + column]
            for coil in range(COILS):
                rate += matrices[SOLUTION + POLES + coil, j] * work[scratch + VOLTAGE + coil]
            row[target + TRACE_RATE + j] = rate
        for coil in range(COILS):
            row[target + TRACE_CURRENT + coil] = work[scratch + CURRENT + coil]
            row[target + TRACE_VOLTAGE + coil] = work[scratch + VOLTAGE + coil]
        for axis in range(2):
            row[target + TRACE_POSITION + axis] = state[POSITION + 2 * bearing + axis]
            row[target + TRACE_VELOCITY + axis] = state[VELOCITY + 2 * bearing + axis]
            row[target + TRACE_FORCE + axis] = work[scratch + PULL + axis]
            row[target + TRACE_CONTACT + axis] = work[scratch + CONTACT_FORCE + axis]
    modes, target = HEAD_SIZE + bearings * BLOCK_SIZE, bearings * TRACE_BLOCK_SIZE + TRACE_TAIL_SIZE
    for n in range(2 * size):
        row[target + n] = state[modes + n]

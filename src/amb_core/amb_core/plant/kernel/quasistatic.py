"""The magnetic circuit without eddy currents: fluxes follow the coil currents at once.

Only the flux linkages of the coils have a rate of change then. The other fluxes - those that no coil with an amplifier
links, and those that circulate in back iron and journal - settle so that the drops balance: Q^T h = 0 for every
direction Q in which fluxes can change with the flux linkages held. The iron's drops count as linear over one step; what
that leaves is put right in the next.
"""

from __future__ import annotations

import math

import numba

from amb_core.plant.kernel.iron import ELEMENTS, FIELD, FLUX_DENSITY, RELUCTIVITY, SLOPE, TARGET
from amb_core.plant.kernel.iron_paths import (
    CIRCULATING,
    POLE_AREA,
    POLE_LENGTH,
    PREDICTED,
    RINGS,
    SCALARS,
    add_drops,
    set_segments,
)
from amb_core.plant.kernel.layout import (
    COSINE,
    FLUX,
    GAP,
    GAP_RELUCTANCE,
    INDUCTANCE,
    NONLINEAR_IRON,
    RELUCTANCE,
    SINE,
    SOLUTION,
    UNIPOLAR,
)
from amb_core.plant.network import COILS, POLES

# Rows of the array: directions Q of pole fluxes and circulating fluxes (10), what they make of the flux densities of
# the iron's elements (24), the matrix of the linear iron in them (12), and scratch: the matrix to solve (12) and its
# right-hand side.
FLUXES = POLES + 2
DENSITIES = FLUXES
LINEAR = DENSITIES + ELEMENTS
MATRIX = LINEAR + 12
RIGHT = MATRIX + 12
QUASISTATIC_SIZE = RIGHT + 1
_MOST_SWEEPS = 60
_CURRENT_TOLERANCE = 1e-9  # A


@numba.njit(cache=True, error_model="numpy")
def balance_fluxes(state, block, position, constants, matrices, iron, paths, quasistatic, work, scratch):
    """Let the fluxes settle around the flux linkages; raise those of coils whose current would be negative.

    Parameters
    ----------
    state, constants, matrices, work, paths : ndarray
        As in `amb_core.plant.kernel.layout` and `iron_paths`.
    block, position, scratch : int
        Where the bearing's block of the state, its position and its scratch begin.
    iron : ndarray, shape (m, 24)
        State of the bearing's iron; without elements for linear iron.
    quasistatic : ndarray
        From `pack_quasistatic`.
    """
    for _ in range(_MOST_SWEEPS):
        _settle(state, block, position, constants, matrices, iron, paths, quasistatic, work, scratch)
        if constants[UNIPOLAR] == 0.0:
            return
        _set_drops(state, block, position, constants, matrices, iron, paths, work, scratch)
        raised = False
        for coil in range(COILS):
            current = 0.0
            for j in range(POLES):
                current += matrices[SOLUTION + j, POLES + coil] * work[scratch + j]
            if current < -_CURRENT_TOLERANCE:
                # Half the inductance of the centred coil: the current comes to zero from below
                linkage = -0.5 * constants[INDUCTANCE] * current
                for j in range(POLES):
                    state[block + FLUX + j] += linkage * matrices[SOLUTION + POLES + coil, j]
                raised = True
        if not raised:
            return


@numba.njit(inline="always", error_model="numpy")
def _gap_reluctance(state, position, constants, matrices, j):
    gap = constants[GAP] - state[position] * matrices[COSINE, j] - state[position + 1] * matrices[SINE, j]
    return gap * constants[GAP_RELUCTANCE]


@numba.njit(inline="always", error_model="numpy")
def _predicted_field(iron, element):
    """Field of an element at its target, by its present slope."""
    change = iron[TARGET, element] - iron[FLUX_DENSITY, element]
    return iron[FIELD, element] + (RELUCTIVITY - iron[SLOPE, element]) * change


@numba.njit(cache=True, error_model="numpy")
def _set_drops(state, block, position, constants, matrices, iron, paths, work, scratch):
    """Drops along the poles."""
    for j in range(POLES):
        drop = _gap_reluctance(state, position, constants, matrices, j) * state[block + FLUX + j]
        for m in range(POLES):
            drop += matrices[RELUCTANCE + m, j] * state[block + FLUX + m]
        work[scratch + j] = drop
    if constants[NONLINEAR_IRON] != 0.0:
        set_segments(state, block, paths, work, scratch, iron)
        for element in range(ELEMENTS):
            iron[PREDICTED, element] = _predicted_field(iron, element)
        add_drops(paths, iron, PREDICTED, work, scratch)


@numba.njit(cache=True, error_model="numpy")
def _settle(state, block, position, constants, matrices, iron, paths, quasistatic, work, scratch):
    """Balance the drops by the free fluxes."""
    size = quasistatic.shape[1]
    for a in range(size):
        quasistatic[RIGHT, a] = 0.0
        for b in range(size):
            quasistatic[MATRIX + a, b] = quasistatic[LINEAR + a, b]
    for j in range(POLES):
        own = _gap_reluctance(state, position, constants, matrices, j)
        drop = own * state[block + FLUX + j]
        for m in range(POLES):
            drop += matrices[RELUCTANCE + m, j] * state[block + FLUX + m]
        for a in range(size):
            quasistatic[RIGHT, a] -= quasistatic[j, a] * drop
            for b in range(a + 1):
                quasistatic[MATRIX + a, b] += quasistatic[j, a] * own * quasistatic[j, b]
    if constants[NONLINEAR_IRON] != 0.0:
        set_segments(state, block, paths, work, scratch, iron)
        for element in range(ELEMENTS):
            path = element // POLES
            volume = paths[SCALARS, POLE_AREA + path] * paths[SCALARS, POLE_LENGTH + path]
            field = volume * _predicted_field(iron, element)
            stiff = volume * (RELUCTIVITY - iron[SLOPE, element])
            for a in range(size):
                density = quasistatic[DENSITIES + element, a]
                quasistatic[RIGHT, a] -= density * field
                for b in range(a + 1):
                    quasistatic[MATRIX + a, b] += stiff * density * quasistatic[DENSITIES + element, b]
    _solve_cholesky(quasistatic, size)
    for a in range(size):
        change = quasistatic[RIGHT, a]
        for j in range(POLES):
            state[block + FLUX + j] += quasistatic[j, a] * change
        if constants[NONLINEAR_IRON] != 0.0:
            for ring in range(2):
                iron[RINGS, CIRCULATING + ring] += quasistatic[POLES + ring, a] * change


@numba.njit(inline="always", error_model="numpy")
def _solve_cholesky(quasistatic, size):
    """Solve in place for the right-hand side; of the matrix, the lower triangle is given."""
    for a in range(size):
        for b in range(a + 1):
            total = quasistatic[MATRIX + a, b]
            for n in range(b):
                total -= quasistatic[MATRIX + a, n] * quasistatic[MATRIX + b, n]
            quasistatic[MATRIX + a, b] = math.sqrt(total) if a == b else total / quasistatic[MATRIX + b, b]
    for a in range(size):
        total = quasistatic[RIGHT, a]
        for n in range(a):
            total -= quasistatic[MATRIX + a, n] * quasistatic[RIGHT, n]
        quasistatic[RIGHT, a] = total / quasistatic[MATRIX + a, a]
    for back in range(size):
        a = size - 1 - back
        total = quasistatic[RIGHT, a]
        for n in range(a + 1, size):
            total -= quasistatic[MATRIX + n, a] * quasistatic[RIGHT, n]
        quasistatic[RIGHT, a] = total / quasistatic[MATRIX + a, a]

"""Compiled part of the integrator that keeps it stable where iron saturates.

A flux that no coil links decays the faster, the less permeable its path is: in saturated iron, within a hundredth of an
internal step. So the rates r that Adams-Bashforth extrapolates may not change at once: with the Jacobian J of the rates
by the fluxes,

    (1 - gamma h J) (r - r_before) = r_extrapolated - r_before

This is of second order as the extrapolation is, as the difference is of the order of h. For the stiffest fluxes, with
gamma = 9/16, both characteristic roots are -1/3: deviations die away. It is done only in steps in which some iron is
stiff. The step of the fluxes that circulate in back iron and journal is finished here too.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.iron import ELEMENTS, RELUCTIVITY, SLOPE
from amb_core.plant.kernel.iron_paths import (
    BACK_AREA,
    BACK_LENGTH,
    CIRCULATING,
    CIRCULATING_LOSS,
    CIRCULATING_RATE,
    CIRCULATION,
    DIFFUSING,
    POLE_AREA,
    POLE_LENGTH,
    RATES_BEFORE,
    RINGS,
    SCALARS,
    SEGMENTS,
    SYSTEM,
)
from amb_core.plant.kernel.layout import (
    COSINE,
    DIFFUSING_WEIGHT,
    GAP,
    GAP_RELUCTANCE,
    RATES,
    RELUCTANCE,
    SINE,
    SOLUTION,
    STARTED,
    STEP,
    STIFF_SLOPE,
)
from amb_core.plant.network import POLES

_GAMMA = 9.0 / 16.0
_RING_COUNT = 2
_SIZE = POLES + _RING_COUNT


@numba.njit(inline="always", error_model="numpy")
def finish_iron_step(state, position, constants, matrices, iron, paths, work, scratch):
    """Make the rates safe, remember them, and move the circulating fluxes.

    Parameters
    ----------
    state, constants, matrices, work, paths, iron : ndarray
        As in `amb_core.plant.kernel.layout` and `iron_paths`; the bearing's iron.
    position, scratch : int
        Where the bearing's position and its scratch begin.
    """
    stiff = False
    for element in range(ELEMENTS):
        stiff |= iron[SLOPE, element] < constants[STIFF_SLOPE]
    if stiff and state[STARTED] != 0.0:
        _slow_down(state, position, constants, matrices, iron, paths, work, scratch)
    for j in range(POLES):
        iron[RATES_BEFORE, j] = work[scratch + RATES + j]
    for ring in range(_RING_COUNT):
        rate = iron[RINGS, CIRCULATING_RATE + ring]
        iron[RATES_BEFORE, POLES + ring] = rate
        iron[RINGS, CIRCULATING + ring] += constants[STEP] * rate
        if paths[SCALARS, CIRCULATION] != 0.0:
            volume = POLES * paths[SCALARS, BACK_LENGTH + ring] * paths[SCALARS, BACK_AREA + ring]
            density_rate = rate / paths[SCALARS, BACK_AREA + ring]
            iron[RINGS, CIRCULATING_LOSS] += constants[STEP] * volume * density_rate**2 / paths[SCALARS, CIRCULATION]


@numba.njit(cache=True, error_model="numpy")
def _slow_down(state, position, constants, matrices, iron, paths, work, scratch):
    _set_reluctances(state, position, constants, matrices, iron, paths)
    _set_system(constants, matrices, iron, paths)
    for j in range(POLES):
        iron[SYSTEM + j, _SIZE] = work[scratch + RATES + j] - iron[RATES_BEFORE, j]
    for ring in range(_RING_COUNT):
        row = POLES + ring
        iron[SYSTEM + row, _SIZE] = iron[RINGS, CIRCULATING_RATE + ring] - iron[RATES_BEFORE, row]
    _solve(iron)
    for j in range(POLES):
        work[scratch + RATES + j] = iron[RATES_BEFORE, j] + iron[SYSTEM + j, _SIZE]
    for ring in range(_RING_COUNT):
        row = POLES + ring
        iron[RINGS, CIRCULATING_RATE + ring] = iron[RATES_BEFORE, row] + iron[SYSTEM + row, _SIZE]


@numba.njit(inline="always", error_model="numpy")
def _set_reluctances(state, position, constants, matrices, iron, paths):
    """Derivatives of the drops by the fluxes, into the columns after those of the system."""
    for j in range(POLES):
        for m in range(_SIZE):
            linear = 0.0
            if m < POLES:
                linear = matrices[RELUCTANCE + m, j] + constants[DIFFUSING_WEIGHT] * paths[DIFFUSING + m, j]
            iron[SYSTEM + j, _SIZE + 1 + m] = linear
        gap = constants[GAP] - state[position] * matrices[COSINE, j] - state[position + 1] * matrices[SINE, j]
        along_pole = (RELUCTIVITY - iron[SLOPE, j]) * paths[SCALARS, POLE_LENGTH] / paths[SCALARS, POLE_AREA]
        iron[SYSTEM + j, _SIZE + 1 + j] += gap * constants[GAP_RELUCTANCE] + along_pole
    for ring in range(_RING_COUNT):
        row = SYSTEM + POLES + ring
        for m in range(_SIZE):
            iron[row, _SIZE + 1 + m] = 0.0
        area, length = paths[SCALARS, BACK_AREA + ring], paths[SCALARS, BACK_LENGTH + ring]
        for segment in range(POLES):
            stiffness = (RELUCTIVITY - iron[SLOPE, (ring + 1) * POLES + segment]) / area
            for m in range(POLES):
                share = paths[SEGMENTS + m, segment]
                for j in range(POLES):
                    iron[SYSTEM + j, _SIZE + 1 + m] += length * stiffness * share * paths[SEGMENTS + j, segment]
                iron[SYSTEM + m, _SIZE + 1 + POLES + ring] += length * stiffness * share
                iron[row, _SIZE + 1 + m] += stiffness * share
            iron[row, _SIZE + 1 + POLES + ring] += stiffness


@numba.njit(inline="always", error_model="numpy")
def _set_system(constants, matrices, iron, paths):
    """1 - gamma h J; the rates of the poles come from the network's solution, those of the rings from mean fields."""
    weight = _GAMMA * constants[STEP]
    for row in range(_SIZE):
        for column in range(_SIZE):
            rate = 0.0
            if row < POLES:
                for j in range(POLES):
                    rate += matrices[SOLUTION + j, row] * iron[SYSTEM + j, _SIZE + 1 + column]
            else:
                area = paths[SCALARS, BACK_AREA + row - POLES]
                rate = -paths[SCALARS, CIRCULATION] * area / POLES * iron[SYSTEM + row, _SIZE + 1 + column]
            iron[SYSTEM + row, column] = (1.0 if row == column else 0.0) - weight * rate


@numba.njit(inline="always", error_model="numpy")
def _solve(iron):
    """Gauss elimination of the system in place, its right-hand side in column 10; pivots by column."""
    for column in range(_SIZE):
        pivot = column
        for row in range(column + 1, _SIZE):
            if abs(iron[SYSTEM + row, column]) > abs(iron[SYSTEM + pivot, column]):
                pivot = row
        if pivot != column:
            for n in range(column, _SIZE + 1):
                kept = iron[SYSTEM + column, n]
                iron[SYSTEM + column, n] = iron[SYSTEM + pivot, n]
                iron[SYSTEM + pivot, n] = kept
        for row in range(column + 1, _SIZE):
            factor = iron[SYSTEM + row, column] / iron[SYSTEM + column, column]
            for n in range(column + 1, _SIZE + 1):
                iron[SYSTEM + row, n] -= factor * iron[SYSTEM + column, n]
    for back in range(_SIZE):
        row = _SIZE - 1 - back
        total = iron[SYSTEM + row, _SIZE]
        for n in range(row + 1, _SIZE):
            total -= iron[SYSTEM + row, n] * iron[SYSTEM + n, _SIZE]
        iron[SYSTEM + row, _SIZE] = total / iron[SYSTEM + row, row]

"""Compiled parts of the integrator for the iron beyond constant permeability.

The flux path of each pole, and the segments of back iron and journal between neighbouring poles, are 24 elements in
series and parallel. Pole fluxes phi and the fluxes c that circulate in the two rings give their flux densities; their
fields, times length, give the drops that the poles see. A circulating flux obeys 8 k dc/dt = -sum_s l H_s, with k the
eddy-current coefficient of a segment: no winding drives it, and with linear iron it is zero.

A solid journal adds to its linear drop R phi, per term n, R m_n with m_n <- a_n m_n + b_n (phi_new - phi_old); see
`amb_core.plant.eddy`.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.iron import FIELD, ROWS, TARGET, WORK, advance_hysteresis, advance_saturation
from amb_core.plant.kernel.layout import (
    EXTRAPOLATED,
    FLUX,
    NONLINEAR_IRON,
    RATES,
    STARTED,
    TRACE_DIFFUSION_ENERGY,
    TRACE_IRON_ENERGY,
)
from amb_core.plant.kernel.products import accumulate
from amb_core.plant.network import POLES

# Rows of the array of the paths, 8 columns
SEGMENTS = 0  # columns of the matrix from pole fluxes to segment fluxes (8)
TO_POLES = 8  # columns of its transpose (8)
DIFFUSING = 16  # columns of the reluctance matrix of a solid journal (A/Wb) (8)
SCALARS = 24
PATHS_SIZE = 25
# Columns of the row SCALARS
POLE_AREA, BACK_AREA, JOURNAL_AREA = 0, 1, 2  # m^2
POLE_LENGTH, BACK_LENGTH, JOURNAL_LENGTH = 3, 4, 5  # m
CIRCULATION = 6  # rate of the flux density that circulates in a ring per mean field along it, 12 / (sigma d^2) (ohm/m)

# Rows of the array of the iron: those of its 24 elements (poles, back iron, journal), then one of the fluxes that
# circulate in back iron and journal (Wb), their rates over the step and at its start (Wb/s), and what their eddy
# currents have lost (J).
RINGS = ROWS
CIRCULATING, CIRCULATING_RATE, CIRCULATING_DRIVE, CIRCULATING_LOSS = 0, 2, 4, 6
RATES_BEFORE = ROWS + 1  # rates over the previous step of pole fluxes and circulating fluxes (Wb/s)
PREDICTED = ROWS + 2  # fields, scratch of `kernel.quasistatic`
SYSTEM = ROWS + 3  # scratch of `kernel.stiff_iron` (10)
IRON_SIZE = ROWS + 13

# Columns of the diffusion array: 8 memories m_n of a term (Wb) and its coefficients a, b. After the rows of the terms,
# one of the fluxes at the previous step, and one of the drops then (A) and the energy taken up since the reset (J).
TERM_KEEP, TERM_GAIN = 8, 9
DIFFUSION_ENERGY = 8
DIFFUSION_COLUMNS = 10


@numba.njit(inline="always", error_model="numpy")
def add_iron_drops(state, block, constants, iron, material, curve, paths, work, scratch):
    """Drops along nonlinear iron, which this moves to the present fluxes."""
    set_segments(state, block, paths, work, scratch, iron)
    if constants[NONLINEAR_IRON] == 1.0:
        advance_saturation(iron, curve)
    else:
        advance_hysteresis(iron, material)
    add_drops(paths, iron, FIELD, work, scratch)
    _circulate(state, iron, paths)


@numba.njit(inline="always", error_model="numpy")
def set_segments(state, block, paths, work, scratch, iron):
    """Flux densities that the elements shall have."""
    per_pole = 1.0 / paths[SCALARS, POLE_AREA]
    per_back, per_journal = 1.0 / paths[SCALARS, BACK_AREA], 1.0 / paths[SCALARS, JOURNAL_AREA]
    back, journal = iron[RINGS, CIRCULATING], iron[RINGS, CIRCULATING + 1]
    for j in range(POLES):
        iron[TARGET, j] = state[block + FLUX + j] * per_pole
    segments = scratch + EXTRAPOLATED
    for segment in range(POLES):
        work[segments + segment] = 0.0
    for half in range(0, POLES, 4):
        accumulate(paths, SEGMENTS, POLES, half, state, block + FLUX, work, segments + half)
    for segment in range(POLES):
        iron[TARGET, POLES + segment] = (work[segments + segment] + back) * per_back
        iron[TARGET, 2 * POLES + segment] = (work[segments + segment] + journal) * per_journal


@numba.njit(inline="always", error_model="numpy")
def add_drops(paths, iron, field, work, scratch):
    """Fields, in a row of the iron's array, times lengths; those of segments on the poles that drive flux there."""
    on_pole, on_back, on_journal = (
        paths[SCALARS, POLE_LENGTH],
        paths[SCALARS, BACK_LENGTH],
        paths[SCALARS, JOURNAL_LENGTH],
    )
    drops = scratch + EXTRAPOLATED
    for half in range(0, POLES, 4):
        for n in range(4):
            segment = half + n
            along = on_back * iron[field, POLES + segment] + on_journal * iron[field, 2 * POLES + segment]
            work[drops + segment] = along
            work[scratch + segment] += on_pole * iron[field, segment]
    for half in range(0, POLES, 4):
        accumulate(paths, TO_POLES, POLES, half, work, drops, work, scratch + half)


@numba.njit(inline="always", error_model="numpy")
def _circulate(state, iron, paths):
    """Rates of the circulating fluxes in the middle of the step, extrapolated by Adams-Bashforth."""
    for ring in range(2):
        field = 0.0
        for segment in range(POLES):
            field += iron[FIELD, (ring + 1) * POLES + segment]
        rate = -paths[SCALARS, CIRCULATION] * paths[SCALARS, BACK_AREA + ring] * field / POLES
        before = rate if state[STARTED] == 0.0 else iron[RINGS, CIRCULATING_DRIVE + ring]
        iron[RINGS, CIRCULATING_RATE + ring] = 1.5 * rate - 0.5 * before
        iron[RINGS, CIRCULATING_DRIVE + ring] = rate


@numba.njit(cache=True, error_model="numpy")
def add_diffusion_drops(state, block, diffusion, paths, work, scratch):
    """Drops by the diffusion into a solid journal, its terms moved on with the flux varying linearly over the step."""
    terms = diffusion.shape[0] - 2
    before, last = terms, terms + 1
    if state[STARTED] == 0.0:
        for j in range(POLES):
            diffusion[before, j] = state[block + FLUX + j]
    for j in range(POLES):
        work[scratch + EXTRAPOLATED + j] = 0.0
    for term in range(terms):
        keep, gain = diffusion[term, TERM_KEEP], diffusion[term, TERM_GAIN]
        for j in range(POLES):
            change = state[block + FLUX + j] - diffusion[before, j]
            diffusion[term, j] = keep * diffusion[term, j] + gain * change
            work[scratch + EXTRAPOLATED + j] += diffusion[term, j]
    drops = scratch + RATES
    for j in range(POLES):
        work[drops + j] = 0.0
    for half in range(0, POLES, 4):
        accumulate(paths, DIFFUSING, POLES, half, work, scratch + EXTRAPOLATED, work, drops + half)
    for j in range(POLES):
        drop = work[drops + j]
        change = state[block + FLUX + j] - diffusion[before, j]
        diffusion[last, DIFFUSION_ENERGY] += 0.5 * (drop + diffusion[last, j]) * change
        diffusion[last, j] = drop
        diffusion[before, j] = state[block + FLUX + j]
        work[scratch + j] += drop


@numba.njit(cache=True, error_model="numpy")
def set_energies(iron, diffusion, paths, row):
    """Energy (J) that nonlinear iron, with its circulating fluxes, and the diffusion took up since the reset."""
    row[TRACE_IRON_ENERGY] = 0.0
    row[TRACE_DIFFUSION_ENERGY] = 0.0
    for bearing in range(iron.shape[0]):
        row[TRACE_IRON_ENERGY] += iron[bearing, RINGS, CIRCULATING_LOSS]
        for path in range(3):
            volume = paths[SCALARS, POLE_AREA + path] * paths[SCALARS, POLE_LENGTH + path]
            for n in range(POLES):
                row[TRACE_IRON_ENERGY] += volume * iron[bearing, WORK, path * POLES + n]
    for bearing in range(diffusion.shape[0]):
        row[TRACE_DIFFUSION_ENERGY] += diffusion[bearing, diffusion.shape[1] - 1, DIFFUSION_ENERGY]

"""Compiled part of the integrator for the flux paths through iron beyond constant permeability.

The flux path of each pole, and the segments of back iron and journal between neighbouring poles, are 24 elements in
series and parallel. With pole fluxes phi, fluxes c that circulate in the two rings, and T from pole fluxes to segments,

    B_pole = phi / A_pole,    B_s = (T phi + c) / A_s
    h <- h + l_pole H(B_pole) + T^T sum_rings l_s H(B_s)
    8 k dc/dt = -sum_s l_s H_s

with k the eddy-current coefficient of a segment: no winding drives c, and with linear iron it is zero. H(B) is in
`kernel.iron`.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.iron import advance_hysteresis, follow_curve
from amb_core.plant.kernel.products import add_product
from amb_core.plant.kernel.records import CURVE_OF_IRON, RINGS
from amb_core.plant.network import POLES


@numba.njit(inline="always", error_model="numpy")
def add_iron_drops(constants, bearing, started):
    """Drops along nonlinear iron, which this moves to the present fluxes."""
    set_targets(constants.paths, bearing)
    if constants.iron == CURVE_OF_IRON:
        follow_curve(bearing.iron, constants.curve)
    else:
        advance_hysteresis(bearing.iron, constants.material)
    add_drops(constants.paths, bearing, bearing.iron.field)
    _circulate(constants.paths, bearing, started)


@numba.njit(inline="always", error_model="numpy")
def set_targets(paths, bearing):
    """Flux densities that the elements shall have."""
    per_pole, per_back, per_journal = 1.0 / paths.area[0], 1.0 / paths.area[1], 1.0 / paths.area[2]
    back, journal = bearing.ring.flux[0], bearing.ring.flux[1]
    for j in range(POLES):
        bearing.iron.target[j] = bearing.flux[j] * per_pole
    for segment in range(POLES):
        bearing.segment[segment] = 0.0
    add_product(paths.to_segments, bearing.flux, bearing.segment)
    for segment in range(POLES):
        bearing.iron.target[POLES + segment] = (bearing.segment[segment] + back) * per_back
        bearing.iron.target[2 * POLES + segment] = (bearing.segment[segment] + journal) * per_journal


@numba.njit(inline="always", error_model="numpy")
def add_drops(paths, bearing, field):
    """Fields of the elements times lengths; those of segments on the poles that drive flux there."""
    on_pole, on_back, on_journal = paths.length[0], paths.length[1], paths.length[2]
    for n in range(POLES):
        bearing.segment[n] = on_back * field[POLES + n] + on_journal * field[2 * POLES + n]
        bearing.drop[n] += on_pole * field[n]
    add_product(paths.to_poles, bearing.segment, bearing.drop)


@numba.njit(inline="always", error_model="numpy")
def _circulate(paths, bearing, started):
    """Rates of the circulating fluxes in the middle of the step, extrapolated by Adams-Bashforth."""
    for ring in range(RINGS):
        field = 0.0
        for segment in range(POLES):
            field += bearing.iron.field[(ring + 1) * POLES + segment]
        rate = -paths.circulation * paths.area[ring + 1] * field / POLES
        before = bearing.ring.drive[ring] if started else rate
        bearing.ring.rate[ring] = 1.5 * rate - 0.5 * before
        bearing.ring.drive[ring] = rate

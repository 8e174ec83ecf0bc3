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

from amb_core.plant.kernel.iron import RELUCTIVITY
from amb_core.plant.kernel.linear_systems import solve_general
from amb_core.plant.kernel.records import ELEMENTS, FLUXES, RINGS
from amb_core.plant.network import POLES

_GAMMA = 9.0 / 16.0


@numba.njit(inline="always", error_model="numpy")
def iron_is_stiff(paths, iron):
    """Whether the fluxes through some iron decay too fast for a step that is not implicit."""
    stiff = False
    for element in range(ELEMENTS):
        stiff |= iron.slope[element] < paths.stiff_slope or abs(iron.flux_density[element]) > paths.stiff_density
    return stiff


@numba.njit(inline="always", error_model="numpy")
def _lowest_slope(paths, iron, element):
    """The dM/dB that an element has, or may have after a reversal of its flux where it is nearly saturated."""
    return 0.0 if abs(iron.flux_density[element]) > paths.stiff_density else iron.slope[element]


@numba.njit(inline="always", error_model="numpy")
def finish_iron_step(constants, bearing, started):
    """Make the rates safe, remember them, and move the circulating fluxes."""
    paths, ring = constants.paths, bearing.ring
    if iron_is_stiff(paths, bearing.iron) and started:
        _slow_down(constants, bearing)
    for j in range(POLES):
        bearing.previous_rate[j] = bearing.rate[j]
    for n in range(RINGS):
        rate = ring.rate[n]
        bearing.previous_rate[POLES + n] = rate
        ring.flux[n] += constants.step * rate
        if paths.circulation != 0.0:
            volume = POLES * paths.length[n + 1] * paths.area[n + 1]
            density_rate = rate / paths.area[n + 1]
            ring.loss += constants.step * volume * density_rate**2 / paths.circulation


@numba.njit(cache=True, error_model="numpy")
def _slow_down(constants, bearing):
    """Solve for the rates."""
    _set_stiffness(constants, bearing)
    _set_system(constants, bearing)
    before, unknown = bearing.previous_rate, bearing.unknown
    for j in range(POLES):
        unknown[j] = bearing.rate[j] - before[j]
    for ring in range(RINGS):
        unknown[POLES + ring] = bearing.ring.rate[ring] - before[POLES + ring]
    solve_general(bearing.system, unknown, FLUXES)
    for j in range(POLES):
        bearing.rate[j] = before[j] + unknown[j]
    for ring in range(RINGS):
        bearing.ring.rate[ring] = before[POLES + ring] + unknown[POLES + ring]


@numba.njit(inline="always", error_model="numpy")
def _set_stiffness(constants, bearing):
    """Derivatives of the drops, and of the rings' mean fields, by the fluxes."""
    paths, journal, stiffness, iron = constants.paths, constants.journal, bearing.stiffness, bearing.iron
    x, y = bearing.position[0], bearing.position[1]
    for j in range(POLES):
        for m in range(FLUXES):
            linear = 0.0
            if m < POLES and constants.diffusion:
                linear = -constants.laminations.reluctance[m, j]  # only the rest of the drops is extrapolated
            elif m < POLES:
                linear = constants.reluctance[m, j] + journal.weight * journal.reluctance[m, j]
            stiffness[j, m] = linear
        gap = 0.0 if constants.diffusion else constants.gap - x * constants.cosine[j] - y * constants.sine[j]
        along_pole = (RELUCTIVITY - _lowest_slope(paths, iron, j)) * paths.length[0] / paths.area[0]
        stiffness[j, j] += gap * constants.gap_reluctance + along_pole
    for ring in range(RINGS):
        row = POLES + ring
        for m in range(FLUXES):
            stiffness[row, m] = 0.0
        area, length = paths.area[ring + 1], paths.length[ring + 1]
        for segment in range(POLES):
            reluctivity = (RELUCTIVITY - _lowest_slope(paths, iron, (ring + 1) * POLES + segment)) / area
            for m in range(POLES):
                share = paths.to_segments[m, segment]
                for j in range(POLES):
                    stiffness[j, m] += length * reluctivity * share * paths.to_segments[j, segment]
                stiffness[m, row] += length * reluctivity * share
                stiffness[row, m] += reluctivity * share
            stiffness[row, row] += reluctivity


@numba.njit(inline="always", error_model="numpy")
def _set_system(constants, bearing):
    """1 - gamma h J; the rates of the poles come from the network's solution, those of the rings from mean fields."""
    paths, stiffness = constants.paths, bearing.stiffness
    weight = _GAMMA * constants.step
    for row in range(FLUXES):
        for column in range(FLUXES):
            rate = 0.0
            if row < POLES:
                for j in range(POLES):
                    rate += constants.rate_by_drop[j, row] * stiffness[j, column]
            else:
                area = paths.area[row - POLES + 1]
                rate = -paths.circulation * area / POLES * stiffness[row, column]
            bearing.system[row, column] = (1.0 if row == column else 0.0) - weight * rate

"""The magnetic circuit without eddy currents: fluxes follow the coil currents at once.

Only the flux linkages of the coils have a rate of change then. The other fluxes - those that no coil with an amplifier
links, and those that circulate in back iron and journal - settle so that the drops balance,

    Q^T h(phi) = 0

for every direction Q in which fluxes can change with the flux linkages held: a Newton step in the coordinates of Q, its
matrix Q^T (dh/dphi) Q. The iron's drops count as linear over one step; what that leaves is put right in the next.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.circuit import set_gap_drops
from amb_core.plant.kernel.iron import RELUCTIVITY
from amb_core.plant.kernel.iron_paths import add_drops, set_targets
from amb_core.plant.kernel.linear_systems import solve_positive
from amb_core.plant.kernel.records import ELEMENTS, LINEAR, RINGS
from amb_core.plant.network import COILS, POLES

_MOST_SWEEPS = 60
_CURRENT_TOLERANCE = 1e-9  # A


@numba.njit(cache=True, error_model="numpy")
def balance_fluxes(constants, bearing):
    """Let the fluxes settle around the flux linkages; raise those of coils whose current would be negative."""
    for _ in range(_MOST_SWEEPS):
        _settle(constants, bearing)
        if not constants.amplifier.unipolar:
            return
        _set_drops(constants, bearing)
        raised = False
        for coil in range(COILS):
            current = 0.0
            for j in range(POLES):
                current += constants.current_by_drop[j, coil] * bearing.drop[j]
            if current < -_CURRENT_TOLERANCE:
                # Half the inductance of the centred coil: the current comes to zero from below
                linkage = -0.5 * constants.balance.inductance * current
                for j in range(POLES):
                    bearing.flux[j] += linkage * constants.rate_by_voltage[coil, j]
                raised = True
        if not raised:
            return


@numba.njit(inline="always", error_model="numpy")
def _predicted_field(iron, element):
    """Field of an element at its target, by its present slope."""
    change = iron.target[element] - iron.flux_density[element]
    return iron.field[element] + (RELUCTIVITY - iron.slope[element]) * change


@numba.njit(cache=True, error_model="numpy")
def _set_drops(constants, bearing):
    """Drops along the poles."""
    set_gap_drops(constants, bearing, True)
    if constants.iron != LINEAR:
        set_targets(constants.paths, bearing)
        for element in range(ELEMENTS):
            bearing.predicted_field[element] = _predicted_field(bearing.iron, element)
        add_drops(constants.paths, bearing, bearing.predicted_field)


@numba.njit(cache=True, error_model="numpy")
def _settle(constants, bearing):
    """Balance the drops by the free fluxes."""
    balance, system, unknown = constants.balance, bearing.system, bearing.unknown
    size = balance.size
    for a in range(size):
        unknown[a] = 0.0
        for b in range(size):
            system[a, b] = balance.reluctance[a, b]
    x, y = bearing.position[0], bearing.position[1]
    for j in range(POLES):
        own = (constants.gap - x * constants.cosine[j] - y * constants.sine[j]) * constants.gap_reluctance
        drop = own * bearing.flux[j]
        for m in range(POLES):
            drop += constants.reluctance[m, j] * bearing.flux[m]
        for a in range(size):
            unknown[a] -= balance.directions[j, a] * drop
            for b in range(a + 1):
                system[a, b] += balance.directions[j, a] * own * balance.directions[j, b]
    if constants.iron != LINEAR:
        _add_iron(constants, bearing)
    solve_positive(system, unknown, size)
    for a in range(size):
        for j in range(POLES):
            bearing.flux[j] += balance.directions[j, a] * unknown[a]
        if constants.iron != LINEAR:
            for ring in range(RINGS):
                bearing.ring.flux[ring] += balance.directions[POLES + ring, a] * unknown[a]


@numba.njit(inline="always", error_model="numpy")
def _add_iron(constants, bearing):
    """Fields and differential reluctivities of nonlinear iron, by volume, in the directions."""
    paths, balance, iron = constants.paths, constants.balance, bearing.iron
    set_targets(paths, bearing)
    for element in range(ELEMENTS):
        path = element // POLES
        volume = paths.area[path] * paths.length[path]
        field = volume * _predicted_field(iron, element)
        stiff = volume * (RELUCTIVITY - iron.slope[element])
        for a in range(balance.size):
            density = balance.densities[element, a]
            bearing.unknown[a] -= density * field
            for b in range(a + 1):
                bearing.system[a, b] += stiff * density * balance.densities[element, b]

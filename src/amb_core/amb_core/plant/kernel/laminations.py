"""Compiled part of the integrator for the diffusion of flux into laminations, and into a solid journal beside them.

The terms of the fit in `amb_core.plant.eddy` are faster than an internal step h, so the circuit is solved for means
over the step, in which fluxes change at constant rates dphi/dt. Then mean drops and the memories m_n are exact,

    h_mean = (g_j + (h / 2) dg_j/dt) (phi + (h / 2) dphi/dt) / (mu0 A) + R (phi + (h / 2) dphi/dt)
             + sum over parts R (sum_n alpha_n m_n + k dphi/dt),
    alpha_n = (1 - exp(-p_n h)) / (p_n h),    k = r + sum_n c_n (1 - alpha_n) / p_n
    m_n <- exp(-p_n h) m_n + c_n alpha_n h dphi/dt

All factors of dphi/dt are constant but for the rotor's displacement and belong to the network's solution; what the
displacement changes follows from the rates without it. Coil currents are means over the step too, so the energy that
the amplifiers deliver is that which windings, gaps and iron take up. w_n = alpha_n m_n is what is stored.

Nonlinear iron adds the difference of its drops from those of constant permeability, by its present slopes: the
diffusion itself is that of constant permeability. Where iron is stiff, the difference is extrapolated to the middle of
the step instead (Adams-Bashforth), which `stiff_iron` makes safe.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.iron import RELUCTIVITY
from amb_core.plant.kernel.products import add_product
from amb_core.plant.kernel.records import LINEAR
from amb_core.plant.kernel.stiff_iron import iron_is_stiff
from amb_core.plant.network import COILS, POLES

_CORRECTIONS = 3


@numba.njit(inline="always", error_model="numpy")
def set_mean_drops(constants, bearing, started):
    """Mean drops over the step but for what its rates add, and the coil currents without voltages.

    The drops of nonlinear iron are there already.
    """
    _set_displaced_gaps(constants, bearing)
    drop, middle = bearing.drop, bearing.middle_drop
    for j in range(POLES):
        middle[j] = 0.0
    if constants.iron != LINEAR:
        for j in range(POLES):
            bearing.segment[j] = -bearing.flux[j]
        add_product(constants.laminations.reluctance, bearing.segment, drop)
        ahead = 0.5 if started and iron_is_stiff(constants.paths, bearing.iron) else 0.0
        for j in range(POLES):
            middle[j] = drop[j] + ahead * (drop[j] - bearing.previous_drop[j])
            bearing.previous_drop[j] = drop[j]
    for j in range(POLES):
        middle[j] += (constants.gap * constants.gap_reluctance + bearing.displaced[j]) * bearing.flux[j]
    _add_part(constants.laminations, bearing.laminations, bearing, middle)
    if constants.solid_journal:
        _add_part(constants.solid, bearing.solid, bearing, middle)
    for coil in range(COILS):
        bearing.current[coil] = 0.0
    add_product(constants.current_by_drop, middle, bearing.current)


@numba.njit(inline="always", error_model="numpy")
def _set_displaced_gaps(constants, bearing):
    """Reluctances of the gaps in the middle of the step beyond those of the centred rotor."""
    ahead = 0.5 * constants.step
    x = bearing.position[0] + ahead * bearing.velocity[0]
    y = bearing.position[1] + ahead * bearing.velocity[1]
    for j in range(POLES):
        bearing.displaced[j] = -constants.gap_reluctance * (x * constants.cosine[j] + y * constants.sine[j])


@numba.njit(inline="always", error_model="numpy")
def _add_part(part, memory, bearing, drop):
    """Add the drops along the linear iron of a part that come from the fluxes so far."""
    for j in range(POLES):
        bearing.segment[j] = bearing.flux[j] + memory.total[j]
    add_product(part.reluctance, bearing.segment, drop)


@numba.njit(inline="always", error_model="numpy")
def correct_rates(constants, bearing):
    """What rotor displacement and nonlinear iron add to rates and currents: a fixed-point iteration from zero.

    Voltages decide the rates of linked fluxes, so they are right at once; those of the others, which are small, come
    closer by the ratio of displacement to air gap every time. An odd number of times keeps the step stable. The iron's
    part, much smaller, is taken once.
    """
    ahead, change = 0.5 * constants.step, bearing.unknown
    for j in range(POLES):
        change[j] = bearing.rate[j]
    if constants.iron != LINEAR and not iron_is_stiff(constants.paths, bearing.iron):
        _correct_iron(constants, bearing, ahead)
    for _ in range(_CORRECTIONS):
        for j in range(POLES):
            bearing.segment[j] = ahead * bearing.displaced[j] * change[j]
            change[j] = 0.0
        add_product(constants.rate_by_drop, bearing.segment, change)
        add_product(constants.current_by_drop, bearing.segment, bearing.current)
        for j in range(POLES):
            bearing.rate[j] += change[j]


@numba.njit(inline="always", error_model="numpy")
def _correct_iron(constants, bearing, ahead):
    """Changes of the drops of nonlinear iron, beyond those of constant permeability, up to the middle of the step."""
    paths, slope, segment, drop = constants.paths, bearing.iron.slope, bearing.segment, bearing.middle_drop
    for n in range(POLES):
        segment[n] = 0.0
        drop[n] = -ahead * bearing.rate[n]
    add_product(paths.to_segments, bearing.rate, segment)
    for n in range(POLES):
        back = RELUCTIVITY - slope[POLES + n]
        journal = RELUCTIVITY - slope[2 * POLES + n]
        back *= paths.length[1] / paths.area[1] * (segment[n] + bearing.ring.rate[0])
        journal *= paths.length[2] / paths.area[2] * (segment[n] + bearing.ring.rate[1])
        segment[n] = ahead * (back + journal)
    for n in range(POLES):
        bearing.unbalanced[n] = ahead * (RELUCTIVITY - slope[n]) * paths.length[0] / paths.area[0] * bearing.rate[n]
    add_product(paths.to_poles, segment, bearing.unbalanced)
    add_product(constants.laminations.reluctance, drop, bearing.unbalanced)
    add_product(constants.rate_by_drop, bearing.unbalanced, bearing.rate)
    add_product(constants.current_by_drop, bearing.unbalanced, bearing.current)


@numba.njit(inline="always", error_model="numpy")
def diffuse(constants, bearing):
    """Move the memories over the step."""
    _move_part(constants.laminations, bearing.laminations, bearing, constants.step)
    if constants.solid_journal:
        _move_part(constants.solid, bearing.solid, bearing, constants.step)


@numba.njit(inline="always", error_model="numpy")
def _move_part(part, memory, bearing, step):
    """Energy that the diffusion into a part takes up over the step, and its memories at the end."""
    for j in range(POLES):
        bearing.segment[j] = memory.total[j] + part.coefficient * bearing.rate[j]
        bearing.unknown[j] = 0.0
    add_product(part.reluctance, bearing.segment, bearing.unknown)
    power = 0.0
    for j in range(POLES):
        power += bearing.unknown[j] * bearing.rate[j]
    bearing.diffusion.energy += step * power
    for first in range(0, POLES, 4):  # running sums as in `products`
        a = b = c = d = 0.0
        of_a, of_b, of_c, of_d = (
            bearing.rate[first],
            bearing.rate[first + 1],
            bearing.rate[first + 2],
            bearing.rate[first + 3],
        )
        for term in range(part.terms):
            keep, gain, mean = part.keep[term], part.gain[term], memory.mean[term]
            in_a = keep * mean[first] + gain * of_a
            in_b = keep * mean[first + 1] + gain * of_b
            in_c = keep * mean[first + 2] + gain * of_c
            in_d = keep * mean[first + 3] + gain * of_d
            mean[first], mean[first + 1], mean[first + 2], mean[first + 3] = in_a, in_b, in_c, in_d
            a, b, c, d = a + in_a, b + in_b, c + in_c, d + in_d
        total = memory.total
        total[first], total[first + 1], total[first + 2], total[first + 3] = a, b, c, d

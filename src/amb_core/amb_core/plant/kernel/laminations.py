"""Compiled part of the integrator for the diffusion of flux into laminations, and into a solid journal beside them.

The terms of the fit in `amb_core.plant.eddy` are faster than an internal step h, so the circuit is solved for means over
the step, in which fluxes change at constant rates dphi/dt. Then mean drops and the memories m_n are exact,

    h_mean = (g_j + (h / 2) dg_j/dt) (phi + (h / 2) dphi/dt) / (mu0 A) + R (phi + (h / 2) dphi/dt)
             + sum over parts R (sum_n alpha_n m_n + k dphi/dt),
    alpha_n = (1 - exp(-p_n h)) / (p_n h),    k = r + sum_n c_n (1 - alpha_n) / p_n
    m_n <- exp(-p_n h) m_n + c_n alpha_n h dphi/dt

All factors of dphi/dt are constant but for the rotor's displacement and belong to the network's solution; what the
displacement changes follows from the rates without it. Coil currents are means over the step too, so the energy that
the amplifiers deliver is that which windings, gaps and iron take up. w_n = alpha_n m_n is what is stored.

Nonlinear iron adds the difference of its drops from those of constant permeability, extrapolated to the middle of the
step (Adams-Bashforth): the diffusion itself is that of constant permeability.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.products import add_product
from amb_core.plant.kernel.records import LINEAR
from amb_core.plant.network import COILS, POLES


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
        for j in range(POLES):
            before = bearing.previous_drop[j] if started else drop[j]
            middle[j] = 1.5 * drop[j] - 0.5 * before
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
        memory.total[j] = 0.0
    for term in range(part.terms):
        for j in range(POLES):
            memory.total[j] += memory.mean[term, j]
    for j in range(POLES):
        bearing.segment[j] = bearing.flux[j] + memory.total[j]
    add_product(part.reluctance, bearing.segment, drop)


@numba.njit(inline="always", error_model="numpy")
def correct_rates(constants, bearing):
    """What the rotor's displacement adds to rates and currents, from the rates without it."""
    ahead = 0.5 * constants.step
    for j in range(POLES):
        bearing.segment[j] = ahead * bearing.displaced[j] * bearing.rate[j]
    add_product(constants.rate_by_drop, bearing.segment, bearing.rate)
    add_product(constants.current_by_drop, bearing.segment, bearing.current)


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
    for term in range(part.terms):
        for j in range(POLES):
            memory.mean[term, j] = part.keep[term] * memory.mean[term, j] + part.gain[term] * bearing.rate[j]

"""Compiled part of the integrator for the diffusion of flux into a solid journal.

To its linear drop R phi, term n of the fit in `amb_core.plant.eddy` adds R m_n, with the flux linear over a step:

    m_n <- a_n m_n + b_n (phi_new - phi_old)
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.products import add_product
from amb_core.plant.network import POLES


@numba.njit(cache=True, error_model="numpy")
def add_diffusion_drops(journal, bearing, started):
    """Drops by the diffusion, its terms moved on to the present fluxes."""
    diffusion, total, drop = bearing.diffusion, bearing.segment, bearing.middle_drop
    if not started:
        for j in range(POLES):
            diffusion.flux[j] = bearing.flux[j]
    for j in range(POLES):
        total[j] = 0.0
        drop[j] = 0.0
    for term in range(journal.terms):
        for j in range(POLES):
            change = bearing.flux[j] - diffusion.flux[j]
            diffusion.memory[term, j] = journal.keep[term] * diffusion.memory[term, j] + journal.gain[term] * change
            total[j] += diffusion.memory[term, j]
    add_product(journal.reluctance, total, drop)
    for j in range(POLES):
        change = bearing.flux[j] - diffusion.flux[j]
        diffusion.energy += 0.5 * (drop[j] + diffusion.drop[j]) * change
        diffusion.drop[j] = drop[j]
        diffusion.flux[j] = bearing.flux[j]
        bearing.drop[j] += drop[j]

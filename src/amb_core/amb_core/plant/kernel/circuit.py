"""Compiled part of the integrator for the magnetic circuit of a bearing with linear iron, coils and forces.

With pole fluxes phi, gaps g_j and coil voltages V, and with R the reluctances of the linear iron
(`amb_core.plant.network` has the equations that S solves),

    h_j = g_j phi_j / (mu0 A) + (R phi)_j,    g_j = g_0 - x cos(theta_j) - y sin(theta_j)
    (dphi/dt, i) = S (h, V)
    f = 1 / (2 mu0 A) sum_j phi_j^2 (cos(theta_j), sin(theta_j))

Over a step, h is extrapolated to the middle (Adams-Bashforth of second order) and V is its exact mean.
"""

from __future__ import annotations

import numba

from amb_core.plant.kernel.products import add_product
from amb_core.plant.network import COILS, POLES


@numba.njit(inline="always", error_model="numpy")
def set_gap_drops(constants, bearing, iron):
    """Magnetomotive force drops h along the gaps and, if asked for, the linear iron of the poles."""
    x, y = bearing.position[0], bearing.position[1]
    for j in range(POLES):
        gap = constants.gap - x * constants.cosine[j] - y * constants.sine[j]
        bearing.drop[j] = gap * constants.gap_reluctance * bearing.flux[j]
    if iron:
        add_product(constants.reluctance, bearing.flux, bearing.drop)


@numba.njit(inline="always", error_model="numpy")
def extrapolate_drops(constants, bearing, started):
    """Drops in the middle of the step, and what the coil currents owe to those at its start."""
    if not started:
        for j in range(POLES):
            bearing.previous_drop[j] = bearing.drop[j]
    for j in range(POLES):
        bearing.middle_drop[j] = 1.5 * bearing.drop[j] - 0.5 * bearing.previous_drop[j]
        bearing.previous_drop[j] = bearing.drop[j]
    for coil in range(COILS):
        bearing.current[coil] = 0.0
    add_product(constants.current_by_drop, bearing.drop, bearing.current)


@numba.njit(inline="always", error_model="numpy")
def set_rates(constants, bearing):
    """Flux rates from the extrapolated drops and the voltages, and the voltages' part of the coil currents."""
    for j in range(POLES):
        bearing.rate[j] = 0.0
    add_product(constants.rate_by_drop, bearing.middle_drop, bearing.rate)
    add_product(constants.rate_by_voltage, bearing.voltage, bearing.rate)
    add_product(constants.current_by_voltage, bearing.voltage, bearing.current)


@numba.njit(inline="always", error_model="numpy")
def set_pull(constants, bearing):
    """Magnetic force on the journal."""
    pull_x = 0.0
    pull_y = 0.0
    for j in range(POLES):
        pull = constants.pull * bearing.flux[j] * bearing.flux[j]
        pull_x += pull * constants.cosine[j]
        pull_y += pull * constants.sine[j]
    bearing.pull[0] = pull_x
    bearing.pull[1] = pull_y


@numba.njit(inline="always", error_model="numpy")
def integrate(constants, bearing):
    """Fluxes at the end of the step; sums of the currents for the amplifiers' means."""
    for j in range(POLES):
        bearing.flux[j] += constants.step * bearing.rate[j]
    for coil in range(COILS):
        bearing.current_sum[coil] += bearing.current[coil]

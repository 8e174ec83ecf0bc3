"""Compiled part of the integrator that writes down the variables of an internal step, one row of numbers."""

from __future__ import annotations

import numba

from amb_core.plant.kernel.records import LINEAR
from amb_core.plant.kernel.rotor import COORDINATE, RATE
from amb_core.plant.network import COILS, POLES

FIELDS = {
    "flux": POLES,
    "flux_rate": POLES,
    "current": COILS,
    "voltage": COILS,
    "position": 2,
    "velocity": 2,
    "force": 2,
    "contact_force": 2,
}
"""What a row has of each bearing, with the number of columns, in the order of `write_trace`."""

ENERGIES = ("iron_energy", "diffusion_energy")
"""What follows, a column each; then come the coordinates of the rotor's modes, and their rates."""


@numba.njit(cache=True, error_model="numpy")
def write_trace(constants, bearings, modes, row):
    """Variables at the start of the step, after its voltages and before it moves anything."""
    column = 0
    for number in range(bearings.shape[0]):
        bearing = bearings[number]
        column = write_values(bearing.flux, row, column)
        for j in range(POLES):
            rate = 0.0
            for n in range(POLES):
                rate += constants.rate_by_drop[n, j] * bearing.drop[n]
            for coil in range(COILS):
                rate += constants.rate_by_voltage[coil, j] * bearing.voltage[coil]
            row[column + j] = bearing.rate[j] if constants.diffusion else rate
        column = write_values(bearing.current, row, column + POLES)
        column = write_values(bearing.voltage, row, column)
        column = write_values(bearing.position, row, column)
        column = write_values(bearing.velocity, row, column)
        column = write_values(bearing.pull, row, column)
        column = write_values(bearing.contact_force, row, column)
    row[column] = _iron_energy(constants, bearings)
    row[column + 1] = 0.0
    for number in range(bearings.shape[0]):
        row[column + 1] += bearings[number].diffusion.energy
    if modes.shape[1] > 0:
        column = write_values(modes[COORDINATE], row, column + 2)
        write_values(modes[RATE], row, column)


@numba.njit(inline="always", error_model="numpy")
def write_values(values, row, column):
    """Write values from a column on; return the next column."""
    for n in range(values.size):
        row[column + n] = values[n]
    return column + values.size


@numba.njit(inline="always", error_model="numpy")
def _iron_energy(constants, bearings):
    """Energy (J) that nonlinear iron, with its circulating fluxes, took up since the reset."""
    total = 0.0
    if constants.iron == LINEAR:
        return total
    paths = constants.paths
    for number in range(bearings.shape[0]):
        bearing = bearings[number]
        total += bearing.ring.loss
        for path in range(3):
            volume = paths.area[path] * paths.length[path]
            for n in range(POLES):
                total += volume * bearing.iron.work[path * POLES + n]
    return total

"""Every internal step of a run, as named arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.plant.axial import AxialTrace
from amb_core.plant.kernel.trace import ENERGIES, FIELDS


@dataclass(frozen=True)
class Trace:
    """Variables at the start of every internal step; of bearing A, with those of bearing B under `bearing_b`.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Time from the first row (s).
    flux, flux_rate : ndarray, shape (n, 8)
        Pole fluxes (Wb) and their rates (Wb/s).
    current, voltage : ndarray, shape (n, 4)
        Coil currents (A) and mean coil voltages over the step (V), electromagnets +x, +y, -x, -y. With diffusion into
        laminations, currents and flux rates are means over the step too.
    position, velocity, force, contact_force : ndarray, shape (n, 2)
        Position (m) and velocity (m/s) of the journal, magnetic force and force of the backup bearing on it (N).
    iron_energy, diffusion_energy : ndarray, shape (n,)
        Energy that nonlinear iron and the diffusion into laminations and solid journals took up since the reset, all
        bearings (J).
    coordinates, rates : ndarray, shape (n, m)
        Generalised coordinates of a rotor in two bearings (units of the modes), and their rates; m = 0 for a point
        mass.
    bearing_b : Trace or None
        The same for bearing B. None for a plant of one bearing.
    axial : AxialTrace or None
        Of the thrust bearing. None without one.
    """

    time: NDArray[np.float64]
    flux: NDArray[np.float64]
    flux_rate: NDArray[np.float64]
    current: NDArray[np.float64]
    voltage: NDArray[np.float64]
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    force: NDArray[np.float64]
    contact_force: NDArray[np.float64]
    iron_energy: NDArray[np.float64]
    diffusion_energy: NDArray[np.float64]
    coordinates: NDArray[np.float64]
    rates: NDArray[np.float64]
    bearing_b: Trace | None = None
    axial: AxialTrace | None = None


def row_size(bearings: int, coordinates: int) -> int:
    """Columns of a trace."""
    return bearings * sum(FIELDS.values()) + len(ENERGIES) + 2 * coordinates


def unpack(rows: NDArray[np.float64], bearings: int, coordinates: int, internal_step: float) -> Trace:
    """Name the columns of a trace, shape (n, row_size(bearings, coordinates)), that the kernel wrote."""
    widths = [*FIELDS.values()] * bearings + [1] * len(ENERGIES) + [coordinates, coordinates]
    *parts, _ = np.split(rows, np.cumsum(widths), axis=1)
    of_bearings = [dict(zip(FIELDS, parts[n * len(FIELDS) :], strict=False)) for n in range(bearings)]
    *energies, coordinate, rate = parts[bearings * len(FIELDS) :]
    shared = {name: column[:, 0] for name, column in zip(ENERGIES, energies, strict=True)}
    shared |= {"coordinates": coordinate, "rates": rate}
    time = np.arange(len(rows), dtype=np.float64) * internal_step
    trace: Trace | None = None
    for own in reversed(of_bearings):
        trace = Trace(time=time, **own, **shared, bearing_b=trace, axial=None)
    assert trace is not None  # there is a bearing
    return trace

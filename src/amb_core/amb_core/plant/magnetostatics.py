"""The magnetic circuit at rest: fluxes of constant currents, with linear or saturating iron.

With nonlinear iron, the fields of poles, back iron and journal follow from the single-valued curve of the material.
Hysteresis makes loops about that curve, so states at rest and linear models lie on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant.iron import saturation_curve
from amb_core.plant.network import POLE_ANGLES, POLES, MagneticNetwork, flux_constraints
from amb_core.plant.parameters import PlantParameters

POLE_DIRECTIONS = np.column_stack([np.cos(POLE_ANGLES), np.sin(POLE_ANGLES)])
RINGS = 2
_ITERATIONS = 60
_TOLERANCE = 1e-12  # of the largest drop or current


@dataclass(frozen=True)
class Magnetised:
    """A magnetic circuit at rest.

    Attributes
    ----------
    flux : ndarray, shape (8,)
        Pole fluxes (Wb).
    circulating : ndarray, shape (2,)
        Fluxes that circulate in back iron and journal (Wb).
    flux_density : ndarray, shape (24,)
        In poles, segments of back iron and of journal (T).
    """

    flux: NDArray[np.float64]
    circulating: NDArray[np.float64]
    flux_density: NDArray[np.float64]


class Magnetostatics:
    """Drops, fluxes and forces of the magnetic circuit.

    Parameters
    ----------
    parameters : PlantParameters
        Geometry and iron.
    network : MagneticNetwork
        Its network.
    """

    def __init__(self, parameters: PlantParameters, network: MagneticNetwork) -> None:
        self._network, self._gap = network, parameters.magnetic_circuit.air_gap
        self._constraints = flux_constraints(parameters.magnetic_circuit.coupling)
        self.nonlinear = parameters.iron.saturation
        self.curve = saturation_curve(parameters.iron) if self.nonlinear else None
        (pole_length, pole_area), (back_length, back_area), (journal_length, journal_area) = network.paths
        if parameters.iron.solid_journal:
            journal_length = 0.0  # linear, and part of the network's reluctance
        segments = len(network.to_segments)
        # From pole fluxes and the two circulating fluxes to the flux densities of all elements
        self.to_flux_density = np.zeros((3 * POLES, POLES + RINGS))
        self.to_flux_density[:POLES, :POLES] = np.eye(POLES) / pole_area
        for ring, area in enumerate((back_area, journal_area)):
            first = (ring + 1) * POLES
            self.to_flux_density[first : first + segments, :POLES] = network.to_segments / area
            if parameters.magnetic_circuit.coupling:
                self.to_flux_density[first : first + segments, POLES + ring] = 1.0 / area
        self._volumes = np.repeat(
            [pole_length * pole_area, back_length * back_area, journal_length * journal_area], POLES
        )
        # Without rings, or with a ring of linear iron, nothing circulates
        used = self._volumes @ (self.to_flux_density[:, POLES:] != 0.0)
        self.rings = np.flatnonzero(used) if self.nonlinear else np.zeros(0, dtype=np.intp)

    def drops(
        self, flux: NDArray[np.float64], circulating: NDArray[np.float64], x: float, y: float
    ) -> NDArray[np.float64]:
        """Magnetomotive force drops (A), shape (10,): along each pole, then around back iron and journal.

        Parameters
        ----------
        flux, circulating : ndarray, shapes (8,), (2,)
            Pole fluxes and circulating fluxes (Wb).
        x, y : float
            Rotor position (m).
        """
        drops = np.zeros(POLES + RINGS)
        drops[:POLES] = self._network.reluctance(x, y, self._gap) @ flux
        if self.curve is not None:
            density = self.to_flux_density @ np.concatenate([flux, circulating])
            # Virtual work: an element takes l H A dB = volume H dB
            drops += self.to_flux_density.T @ (self._volumes * self.curve.field(density))
        return drops

    def differential_reluctance(
        self, flux: NDArray[np.float64], circulating: NDArray[np.float64], x: float, y: float
    ) -> NDArray[np.float64]:
        """Derivative of `drops` with respect to the fluxes (A/Wb), shape (10, 10), symmetric."""
        jacobian = np.zeros((POLES + RINGS, POLES + RINGS))
        jacobian[:POLES, :POLES] = self._network.reluctance(x, y, self._gap)
        if self.curve is not None:
            density = self.to_flux_density @ np.concatenate([flux, circulating])
            stiff = self._volumes * self.curve.differential_reluctivity(density)
            jacobian += (self.to_flux_density.T * stiff) @ self.to_flux_density
        return jacobian

    def solve(self, coil_currents: NDArray[np.float64], x: float, y: float) -> Magnetised:
        """Fluxes of constant coil currents (A), shape (4,), at a rotor position (m).

        Raises
        ------
        PlantError
            If no solution is found for saturated iron.
        """
        kept = np.concatenate([np.arange(POLES), POLES + self.rings])
        constraints = np.zeros((len(kept), self._constraints.shape[1]))
        constraints[:POLES] = self._constraints
        drive = np.zeros(len(kept))
        drive[:POLES] = self._network.winding @ coil_currents
        zeros = np.zeros((constraints.shape[1], constraints.shape[1]))

        def spread(solved: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            fluxes = np.zeros(POLES + RINGS)
            fluxes[kept] = solved[: len(kept)]
            return fluxes[:POLES], fluxes[POLES:]

        def residual(solved: NDArray[np.float64]) -> NDArray[np.float64]:
            left = drive - self.drops(*spread(solved), x, y)[kept] - constraints @ solved[len(kept) :]
            return np.concatenate([left, zeros[0]])

        solved = np.zeros(len(kept) + len(zeros))  # fluxes, then potentials
        left = residual(solved)
        allowed = _TOLERANCE * max(float(np.abs(drive).max()), 1e-6)
        for _ in range(_ITERATIONS):
            jacobian = self.differential_reluctance(*spread(solved), x, y)[np.ix_(kept, kept)]
            change = np.linalg.solve(np.block([[jacobian, constraints], [constraints.T, zeros]]), left)
            share = 1.0
            while share > 1e-6 and np.abs(residual(solved + share * change)).max() > np.abs(left).max():
                share *= 0.5
            solved = solved + share * change
            left = residual(solved)
            if not self.nonlinear or np.abs(left).max() <= allowed:
                break
        else:
            raise PlantError(
                f"no fluxes found for coil currents {np.round(coil_currents, 3)} A at rotor position {x:g} m, {y:g} m: "
                "the curve of the iron is too sharp"
            )
        flux, circulating = spread(solved)
        return Magnetised(flux, circulating, self.to_flux_density @ np.concatenate([flux, circulating]))

    def force(self, flux: NDArray[np.float64]) -> NDArray[np.float64]:
        """Force on the rotor (N), shape (..., 2), of pole fluxes (Wb), shape (..., 8)."""
        return np.asarray((flux**2 / (2.0 * mu_0 * self._network.pole_area)) @ POLE_DIRECTIONS)

    def fastest_mean_rate(self) -> float:
        """Fastest rate of the mean fluxes over an internal step with the rotor centred (1/s), at most 2 over the step.

        It belongs to diffusion into laminations, where `MagneticNetwork.step_solution` is that of means.
        """
        reluctance = self._network.reluctance(0.0, 0.0, self._gap)
        return float(np.abs(np.linalg.eigvals(self._network.step_solution[:POLES, :POLES] @ reluctance)).max())

    def shortest_time_constant(self) -> float:
        """Shortest time constant of the eddy currents with the rotor centred (s), infinite without eddy currents."""
        reluctance = self.differential_reluctance(np.zeros(POLES), np.zeros(RINGS), 0.0, 0.0)[:POLES, :POLES]
        fast = reluctance + sum(part.terms.weights.sum() * part.reluctance for part in self._network.diffusing)
        rate = float(np.abs(np.linalg.eigvals(self._network.solution[:POLES, :POLES] @ fast)).max())
        return 1.0 / rate if rate > 0.0 else np.inf

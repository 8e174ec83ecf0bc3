"""The magnetic circuit as constant matrices: eight-pole reluctance network with iron, eddy currents and four coils.

Poles j = 0..7 stand at theta_j = 22.5 deg + 45 deg j; electromagnets c are +x (poles 7, 0), +y (1, 2), -x (3, 4),
-y (5, 6). With pole fluxes phi_j (positive from stator to journal), gaps g_j and coil currents i_c,

    K dphi/dt + E psi - N_p S i = -h,   h = diag(g_j / (mu0 A)) phi + R phi
    E^T dphi/dt = 0
    N_p S^T dphi/dt + R_c i = V

where R holds the reluctances of poles, back iron and journal, K their eddy-current coefficients
sigma d^2 l / (12 A) (thin laminations), S the winding polarity, and psi the magnetic potential between the rings.
Nothing but h depends on the state, so the system is solved once for dphi/dt and i as a matrix on (-h, V).

Sources: Meeker, Maslen, Noh, "Augmented circuit model for magnetic bearings including eddy currents, fringing, and
leakage", IEEE Trans. Magn. 32 (1996); Stoll, "The Analysis of Eddy Currents", Oxford 1974 (thin laminations);
Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 3 (heteropolar radial bearing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.plant.parameters import MagneticCircuitParameters

POLES = 8
COILS = 4
POLE_ANGLES = np.deg2rad(22.5 + 45.0 * np.arange(POLES))
COIL_POLES = ((7, 0), (1, 2), (3, 4), (5, 6))
"""Poles of the electromagnets +x, +y, -x, -y."""
COIL_AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
"""Direction in which each electromagnet pulls; also the sign with which a control current reference enters it."""
POLARITY = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
"""Winding polarity of the poles: neighbours of different electromagnets are alike (N S S N N S S N)."""


@dataclass(frozen=True)
class MagneticNetwork:
    """The network, solved for its rates.

    Attributes
    ----------
    gap_reluctance : float
        Reluctance of one metre of air gap, 1 / (mu0 A) (A/(Wb m)).
    pole_area : float
        Area of a pole face A (m^2).
    iron_reluctance : ndarray, shape (8, 8)
        R: poles, back iron and journal (A/Wb), symmetric.
    eddy_coefficient : ndarray, shape (8, 8)
        K (A s/Wb), symmetric.
    winding : ndarray, shape (8, 4)
        N_p S: turns of each coil on each pole with sign (-).
    solution : ndarray, shape (12, 12)
        Maps (h, V) to (dphi/dt, i): h in A, V in V, dphi/dt in V per turn, i in A.
    """

    gap_reluctance: float
    pole_area: float
    iron_reluctance: NDArray[np.float64]
    eddy_coefficient: NDArray[np.float64]
    winding: NDArray[np.float64]
    solution: NDArray[np.float64]

    def reluctance(self, x: float, y: float, air_gap: float) -> NDArray[np.float64]:
        """Total reluctance matrix diag(g_j / (mu0 A)) + R at a rotor position (A/Wb), shape (8, 8)."""
        return np.diag(pole_gaps(x, y, air_gap) * self.gap_reluctance) + self.iron_reluctance


def pole_gaps(x: float, y: float, air_gap: float) -> NDArray[np.float64]:
    """Air gap under each pole at rotor position x, y (m), shape (8,)."""
    return air_gap - x * np.cos(POLE_ANGLES) - y * np.sin(POLE_ANGLES)


def build_network(parameters: MagneticCircuitParameters) -> MagneticNetwork:
    """Build and solve the network.

    Parameters
    ----------
    parameters : MagneticCircuitParameters
        Geometry, windings and iron.
    """
    area = parameters.pole_width * parameters.axial_length
    poles = (parameters.back_iron_inner_radius - parameters.pole_radius, area)
    back_iron = _ring_segment(parameters.back_iron_inner_radius, parameters.stator_outer_radius, parameters)
    journal = _ring_segment(parameters.journal_inner_radius, parameters.journal_outer_radius, parameters)
    ring = _ring_operator(parameters.coupling)

    def assemble(coefficient: float) -> NDArray[np.float64]:
        on_poles, on_back_iron, on_journal = (
            coefficient * length / section for length, section in (poles, back_iron, journal)
        )
        return on_poles * np.eye(POLES) + (on_back_iron + on_journal) * ring

    reluctance = assemble(1.0 / (parameters.relative_permeability * mu_0))
    eddy = assemble(parameters.iron_conductivity * parameters.lamination_thickness**2 / 12.0)
    winding = np.zeros((POLES, COILS))
    for coil, pair in enumerate(COIL_POLES):
        winding[list(pair), coil] = parameters.turns_per_pole * POLARITY[list(pair)]
    return MagneticNetwork(
        gap_reluctance=1.0 / (mu_0 * area),
        pole_area=area,
        iron_reluctance=reluctance,
        eddy_coefficient=eddy,
        winding=winding,
        solution=_solve(eddy, winding, flux_constraints(parameters.coupling), parameters.coil_resistance),
    )


def flux_constraints(coupling: bool) -> NDArray[np.float64]:
    """E: the sets of poles whose fluxes sum to zero, shape (8, 1) coupled or (8, 4) with separate circuits."""
    if coupling:
        return np.ones((POLES, 1))
    sets = np.zeros((POLES, COILS))
    for coil, pair in enumerate(COIL_POLES):
        sets[list(pair), coil] = 1.0
    return sets


def _ring_segment(inner: float, outer: float, parameters: MagneticCircuitParameters) -> tuple[float, float]:
    """Mean length and section of the ring between two neighbouring poles."""
    return np.pi * (inner + outer) / POLES, (outer - inner) * parameters.axial_length


def _ring_operator(coupling: bool) -> NDArray[np.float64]:
    """T^T T, with T from pole fluxes to the fluxes in the segments of one ring (no ring carries a net MMF)."""
    if coupling:
        segments = np.tril(np.ones((POLES, POLES)))
        to_segments = segments - segments.mean(axis=0)
    else:
        to_segments = np.zeros((COILS, POLES))
        for coil, (first, second) in enumerate(COIL_POLES):
            to_segments[coil, [first, second]] = 0.5, -0.5
    return to_segments.T @ to_segments


def _solve(
    eddy: NDArray[np.float64], winding: NDArray[np.float64], constraints: NDArray[np.float64], resistance: float
) -> NDArray[np.float64]:
    circuits = constraints.shape[1]
    size = POLES + circuits + COILS
    fluxes, potentials, coils = np.split(np.arange(size), [POLES, POLES + circuits])
    system = np.zeros((size, size))
    system[np.ix_(fluxes, fluxes)] = eddy
    system[np.ix_(fluxes, potentials)] = constraints
    system[np.ix_(fluxes, coils)] = -winding
    system[np.ix_(potentials, fluxes)] = constraints.T
    system[np.ix_(coils, fluxes)] = winding.T
    system[np.ix_(coils, coils)] = resistance * np.eye(COILS)
    inverse = np.linalg.inv(system)
    wanted, given = np.concatenate([fluxes, coils]), np.concatenate([fluxes, coils])
    solution = inverse[np.ix_(wanted, given)]
    solution[:, :POLES] *= -1.0
    return np.ascontiguousarray(solution)

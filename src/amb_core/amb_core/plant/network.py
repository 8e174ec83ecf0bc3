"""The magnetic circuit as constant matrices: eight-pole reluctance network with iron, eddy currents and four coils.

Poles j = 0..7 are at theta_j = 22.5 deg + 45 deg j; electromagnets c are +x (poles 7, 0), +y (1, 2), -x (3, 4),
-y (5, 6). With pole fluxes phi_j (positive from stator to journal), gaps g_j and coil currents i_c,

    K dphi/dt + E psi - N_p S i = -h,   h = diag(g_j / (mu0 A)) phi + R phi
    E^T dphi/dt = 0
    N_p S^T dphi/dt + R_c i = V

where R holds the reluctances of poles, back iron and journal, K their eddy-current coefficients
sigma d^2 l / (12 A) (thin laminations), S the winding polarity, and psi the magnetic potential between the rings.
Only h depends on the state, so the system is solved once: dphi/dt and i are a constant matrix times (-h, V).

Sources: Meeker, Maslen, Noh, "Augmented circuit model for magnetic bearings including eddy currents, fringing, and
leakage", IEEE Trans. Magn. 32 (1996); Stoll, "The Analysis of Eddy Currents", Oxford 1974 (thin laminations);
Schweitzer, Maslen (eds.), "Magnetic Bearings", Springer 2009, ch. 3 (heteropolar radial bearing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.plant.eddy import DiffusionTerms, lamination_terms, solid_journal_terms
from amb_core.plant.parameters import MagneticCircuitParameters, PlantParameters

POLES = 8
COILS = 4
POLE_ANGLES = np.deg2rad(22.5 + 45.0 * np.arange(POLES))
COIL_POLES = ((7, 0), (1, 2), (3, 4), (5, 6))
"""Poles of the electromagnets +x, +y, -x, -y."""
COIL_AXES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
"""Direction in which each electromagnet pulls; also the sign with which a control current reference enters it."""
_LEFT_WITHOUT_EDDY_CURRENTS = 1e-3
POLARITY = np.array([-1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
"""Winding polarity of the poles: neighbours of different electromagnets have the same polarity (N S S N N S S N)."""


@dataclass(frozen=True)
class DiffusingIron:
    """Iron into which flux diffuses.

    Attributes
    ----------
    reluctance : ndarray, shape (8, 8)
        Its part of R if its iron is linear (A/Wb).
    terms : DiffusionTerms
        The diffusion.
    """

    reluctance: NDArray[np.float64]
    terms: DiffusionTerms


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
        R: poles, back iron and journal, if their iron is linear (A/Wb), symmetric.
    eddy_coefficient : ndarray, shape (8, 8)
        K (A s/Wb), symmetric.
    winding : ndarray, shape (8, 4)
        N_p S: turns of each coil on each pole with sign (-).
    solution : ndarray, shape (12, 12)
        Maps (h, V) to (dphi/dt, i): h in A, V in V, dphi/dt in V per turn, i in A. Zero for coils without amplifier.
    step_solution : ndarray, shape (12, 12)
        What the integrator uses: with diffusion into laminations it maps means of (h, V) over an internal step, less
        what the rates add to h with the rotor centred, to means of (dphi/dt, i); otherwise it is `solution`.
    averaged_solution : ndarray, shape (12, 12)
        The same for the averaged plant: without eddy currents, with a thousandth of them.
    circulation : ndarray, shape (2,)
        Rate of the flux that circulates in back iron or journal per drop around it (Wb/(A s)); zero without such rings.
    to_segments : ndarray, shape (8, 8) or (4, 8)
        T: from pole fluxes to the fluxes in the segments of back iron or journal, none of them circulating.
    journal_reluctance : ndarray, shape (8, 8)
        Part of the journal in R if its iron is linear (A/Wb).
    diffusing : tuple of DiffusingIron
        Laminations, unless they are thin, and a solid journal.
    paths : tuple of three pairs
        Length (m) and section (m^2) of a pole, a segment of the back iron, a segment of the journal.
    """

    gap_reluctance: float
    pole_area: float
    iron_reluctance: NDArray[np.float64]
    eddy_coefficient: NDArray[np.float64]
    winding: NDArray[np.float64]
    solution: NDArray[np.float64]
    step_solution: NDArray[np.float64]
    averaged_solution: NDArray[np.float64]
    circulation: NDArray[np.float64]
    to_segments: NDArray[np.float64]
    journal_reluctance: NDArray[np.float64]
    diffusing: tuple[DiffusingIron, ...]
    paths: tuple[tuple[float, float], tuple[float, float], tuple[float, float]]

    def reluctance(self, x: float, y: float, air_gap: float) -> NDArray[np.float64]:
        """Total reluctance matrix diag(g_j / (mu0 A)) + R at a rotor position (A/Wb), shape (8, 8)."""
        return np.diag(pole_gaps(x, y, air_gap) * self.gap_reluctance) + self.iron_reluctance


def pole_gaps(x: float, y: float, air_gap: float) -> NDArray[np.float64]:
    """Air gap under each pole at rotor position x, y (m), shape (8,)."""
    return air_gap - x * np.cos(POLE_ANGLES) - y * np.sin(POLE_ANGLES)


def build_network(parameters: PlantParameters) -> MagneticNetwork:
    """Build and solve the network.

    Parameters
    ----------
    parameters : PlantParameters
        Geometry, windings, amplifiers present, and iron.
    """
    circuit, iron = parameters.magnetic_circuit, parameters.iron
    area = circuit.pole_width * circuit.axial_length
    poles = (circuit.back_iron_inner_radius - circuit.pole_radius, area)
    back_iron = _ring_segment(circuit.back_iron_inner_radius, circuit.stator_outer_radius, circuit)
    journal = _ring_segment(circuit.journal_inner_radius, circuit.journal_outer_radius, circuit)
    to_segments = _to_segments(circuit.coupling)
    ring = to_segments.T @ to_segments

    def on_poles(path: tuple[float, float]) -> NDArray[np.float64]:
        return path[0] / path[1] * (np.eye(POLES) if path is poles else ring)

    per_length = 1.0 / (circuit.relative_permeability * mu_0)
    laminations = circuit.iron_conductivity * circuit.lamination_thickness**2 / 12.0
    stator, rotor = on_poles(poles) + on_poles(back_iron), on_poles(journal)
    journal_reluctance = per_length * rotor
    reluctance = np.zeros((POLES, POLES)) if iron.saturation else per_length * stator
    diffusing = _diffusing_iron(parameters, per_length, stator, rotor)
    if iron.laminations == "diffusion":
        eddy = sum((part.terms.rest * part.reluctance for part in diffusing), np.zeros((POLES, POLES)))
    elif iron.solid_journal:
        eddy = laminations * stator + diffusing[0].terms.rest * journal_reluctance
    else:
        eddy = laminations * (stator + rotor)
    if iron.solid_journal or not iron.saturation:
        reluctance += journal_reluctance
    winding = _winding(circuit.turns_per_pole)
    constraints, active = flux_constraints(circuit.coupling), active_coils(circuit)
    share = 1.0 if iron.eddy_currents else _LEFT_WITHOUT_EDDY_CURRENTS
    averaged = _solve(share * eddy, winding, constraints, circuit.coil_resistance, active)
    rings = np.array([POLES * share * laminations * length / section for length, section in (back_iron, journal)])
    solution = averaged if iron.eddy_currents else _solve_static(winding, constraints, circuit.coil_resistance, active)
    step_solution = solution
    if iron.laminations == "diffusion":
        by_rate = _reluctance_of_a_step(parameters, area, diffusing)
        step_solution = _solve(by_rate, winding, constraints, circuit.coil_resistance, active)
    return MagneticNetwork(
        gap_reluctance=1.0 / (mu_0 * area),
        pole_area=area,
        iron_reluctance=reluctance,
        eddy_coefficient=eddy if iron.eddy_currents else 0.0 * eddy,
        winding=winding,
        solution=solution,
        step_solution=step_solution,
        averaged_solution=averaged,
        circulation=1.0 / rings if circuit.coupling else np.zeros(2),
        to_segments=to_segments,
        journal_reluctance=journal_reluctance,
        diffusing=diffusing,
        paths=(poles, back_iron, journal),
    )


def _diffusing_iron(
    parameters: PlantParameters, per_length: float, stator: NDArray[np.float64], rotor: NDArray[np.float64]
) -> tuple[DiffusingIron, ...]:
    """Parts of the iron into which flux diffuses: the laminations first, then a solid journal."""
    iron, parts = parameters.iron, []
    if iron.laminations == "diffusion":
        laminated = stator if iron.solid_journal else stator + rotor
        parts.append(DiffusingIron(per_length * laminated, lamination_terms(parameters)))
    if iron.solid_journal:
        parts.append(DiffusingIron(per_length * rotor, solid_journal_terms(parameters)))
    return tuple(parts)


def _winding(turns_per_pole: int) -> NDArray[np.float64]:
    """Turns of each coil on each pole, with their polarity."""
    winding = np.zeros((POLES, COILS))
    for coil, pair in enumerate(COIL_POLES):
        winding[list(pair), coil] = turns_per_pole * POLARITY[list(pair)]
    return winding


def _reluctance_of_a_step(
    parameters: PlantParameters, area: float, diffusing: tuple[DiffusingIron, ...]
) -> NDArray[np.float64]:
    """What flux rates meet within an internal step, times its length: centred gaps, and diffusion as far as it gets."""
    step = parameters.integration.internal_step
    by_rate = 0.5 * step * parameters.magnetic_circuit.air_gap / (mu_0 * area) * np.eye(POLES)
    for part in diffusing:
        by_rate += (0.5 * step + part.terms.mean(step)[1]) * part.reluctance
    return by_rate


def active_coils(circuit: MagneticCircuitParameters) -> tuple[int, ...]:
    """Electromagnets that have an amplifier; the others carry no current."""
    return {"two_axis": (0, 1, 2, 3), "differential": (1, 3), "top_coil": (1,)}[circuit.actuators]


def flux_constraints(coupling: bool) -> NDArray[np.float64]:
    """E: the sets of poles whose fluxes sum to zero, shape (8, 1) coupled or (8, 4) with separate circuits."""
    if coupling:
        return np.ones((POLES, 1))
    sets = np.zeros((POLES, COILS))
    for coil, pair in enumerate(COIL_POLES):
        sets[list(pair), coil] = 1.0
    return sets


def _ring_segment(inner: float, outer: float, circuit: MagneticCircuitParameters) -> tuple[float, float]:
    """Mean length and section of the ring between two neighbouring poles."""
    return np.pi * (inner + outer) / POLES, (outer - inner) * circuit.axial_length


def _to_segments(coupling: bool) -> NDArray[np.float64]:
    if coupling:
        segments = np.tril(np.ones((POLES, POLES)))
        return np.asarray(segments - segments.mean(axis=0))
    to_segments = np.zeros((COILS, POLES))
    for coil, (first, second) in enumerate(COIL_POLES):
        to_segments[coil, [first, second]] = 0.5, -0.5
    return to_segments


def _solve(
    eddy: NDArray[np.float64],
    winding: NDArray[np.float64],
    constraints: NDArray[np.float64],
    resistance: float,
    active: tuple[int, ...],
) -> NDArray[np.float64]:
    circuits = constraints.shape[1]
    fluxes, potentials, coils = np.split(np.arange(POLES + circuits + len(active)), [POLES, POLES + circuits])
    size = POLES + circuits + len(active)
    system = np.zeros((size, size))
    system[np.ix_(fluxes, fluxes)] = eddy
    system[np.ix_(fluxes, potentials)] = constraints
    system[np.ix_(fluxes, coils)] = -winding[:, active]
    system[np.ix_(potentials, fluxes)] = constraints.T
    system[np.ix_(coils, fluxes)] = winding[:, active].T
    system[np.ix_(coils, coils)] = resistance * np.eye(len(active))
    inverse = np.linalg.inv(system)
    kept = np.concatenate([fluxes, coils])
    placed = np.concatenate([fluxes, POLES + np.array(active)])
    solution = np.zeros((POLES + COILS, POLES + COILS))
    solution[np.ix_(placed, placed)] = inverse[np.ix_(kept, kept)]
    solution[:, :POLES] *= -1.0
    return solution


def _solve_static(
    winding: NDArray[np.float64], constraints: NDArray[np.float64], resistance: float, active: tuple[int, ...]
) -> NDArray[np.float64]:
    """The same without eddy currents.

    Fluxes in equilibrium, h = N_p S i - E psi, give the currents. The voltages left after the resistive drop move the
    flux linkages by the smallest fluxes, which `amb_core.plant.kernel.quasistatic` then balances.
    """
    solution = np.zeros((POLES + COILS, POLES + COILS))
    placed = POLES + np.array(active)
    currents = np.linalg.pinv(np.hstack([winding[:, active], -constraints]))[: len(active)]
    fluxes = np.linalg.pinv(np.hstack([winding[:, active], constraints]).T)[:, : len(active)]
    solution[placed, :POLES] = currents
    solution[:POLES, placed] = fluxes
    solution[:POLES, :POLES] = -resistance * fluxes @ currents
    return solution

"""Eddy currents: the lag of a solid journal as few terms for the kernel, and the force bandwidth in closed form.

A flux that flows along a slab of permeability mu and conductivity sigma enters it by diffusion. Driven from one face, a
segment of length l, depth D and section A has the magnetomotive force (s the Laplace variable)

    R u coth(u) phi,    R = l / (mu A),    u = sqrt(s tau),    tau = sigma mu D^2

A lamination of thickness d is driven from both faces, so D = d / 2, and its time constants lie far above every frequency
of interest: u coth(u) ~ 1 + s tau / 3, the eddy coefficient sigma d^2 l / (12 A) of `amb_core.plant.network`. A solid
journal is centimetres deep and tau is seconds, so it lags as the square root of s and needs memory.

Sources: Stoll, "The Analysis of Eddy Currents", Oxford 1974, ch. 2 (slab); Meeker, Maslen, Noh, "Augmented circuit model
for magnetic bearings including eddy currents, fringing, and leakage", IEEE Trans. Magn. 32 (1996); Zhu, Knospe, Maslen,
"Analytic model for a nonlaminated cylindrical magnetic actuator including eddy currents", IEEE Trans. Magn. 41 (2005).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0
from scipy.optimize import nnls

from amb_core.errors import PlantError
from amb_core.plant.parameters import PlantParameters

ACCURACY = 0.01
"""Largest relative error of the terms' complex response up to their highest frequency (0.01 rad is 0.57 deg)."""
HIGHEST_FREQUENCY = 100e3
"""No more than this is asked of the terms (Hz)."""
_STEPS_PER_PERIOD = 45  # internal steps per period of the highest frequency: the rest lasts two steps, see below
_MOST_TERMS = 24


@dataclass(frozen=True)
class SolidJournal:
    """Diffusion into a solid journal as a passive sum: u coth(u) ~ 1 + sum_n c_n s / (s + p_n) + r s.

    Each term remembers, for every pole, by how much its flux leads: m_n = c_n (phi - q_n) with q_n' = p_n (phi - q_n).
    With J = T^T T the operator from pole fluxes to the drops of a ring of unit reluctance and R_j the reluctance of a
    segment, the journal's drops are

        R_j J (phi + sum_n m_n + r dphi/dt)

    R_j J belongs to the constant reluctance matrix, R_j r J to the constant eddy-current matrix (in place of the
    journal's laminations), and R_j J sum_n m_n is added to the drops. m_n is zero at rest. The term stores the energy
    R_j m_n J m_n / (2 c_n) and loses the power R_j p_n m_n J m_n / c_n.

    Attributes
    ----------
    weights : ndarray, shape (n,)
        c_n > 0 (-).
    rates : ndarray, shape (n,)
        p_n (1/s), ascending.
    rest : float
        r > 0 (s): all that is faster than the terms.
    time_constant : float
        tau (s).
    segment_reluctance : float
        R_j, of the journal between two poles (A/Wb).
    highest_frequency : float
        Up to it, from 0 Hz, the sum was fitted (Hz).
    """

    weights: NDArray[np.float64]
    rates: NDArray[np.float64]
    rest: float
    time_constant: float
    segment_reluctance: float
    highest_frequency: float

    def response(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Approximation of u coth(u) at frequencies (Hz)."""
        s = 2j * np.pi * np.asarray(frequency, dtype=np.float64)
        return 1.0 + (s[..., None] / (s[..., None] + self.rates)) @ self.weights + self.rest * s

    def error(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Relative error at frequencies (Hz): its real part is that of the magnitude, its imaginary part phase (rad)."""
        return self.response(frequency) / diffusion(frequency, self.time_constant) - 1.0

    def update(self, step: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Coefficients a, b, each of shape (n,), of the recursion m_n <- a_n m_n + b_n (phi_new - phi_old).

        It is exact for a flux that is linear within the step (s), so of second order otherwise.
        """
        exponent = self.rates * step
        return np.exp(-exponent), -self.weights * np.expm1(-exponent) / exponent


def diffusion(frequency: NDArray[np.float64], time_constant: float) -> NDArray[np.complex128]:
    """u coth(u) with u = sqrt(s tau) at frequencies (Hz), tau (s): reluctance of a slab over that of constant flux."""
    u = np.sqrt(2j * np.pi * np.asarray(frequency, dtype=np.float64) * time_constant)
    at_rest = u == 0.0
    return np.where(at_rest, 1.0, u / np.tanh(np.where(at_rest, 1.0, u)))


def solid_journal_terms(parameters: PlantParameters) -> SolidJournal:
    """Fit a solid journal by as few terms as hold the accuracy.

    Rates are spaced logarithmically from the slowest mode of diffusion, pi^2 / tau, to just above the highest
    frequency; the weights follow by non-negative least squares of the relative error, so the sum is passive.

    The higher the highest frequency, the smaller r, and r / (1 + sum_n c_n) = 0.05 / highest frequency is the shortest
    time constant that the journal can give to the magnetic circuit. The highest frequency is therefore what 45 internal
    steps resolve, 44 kHz for 0.5 us, and at most 100 kHz: then this time constant is two internal steps. Above, the
    error grows slowly, to 8 % at 100 kHz.

    Parameters
    ----------
    parameters : PlantParameters
        Geometry, relative permeability, conductivity of the journal and internal step; `iron.solid_journal` itself is
        not asked.

    Raises
    ------
    PlantError
        If 24 terms do not hold the accuracy.
    """
    circuit = parameters.magnetic_circuit
    depth = circuit.journal_outer_radius - circuit.journal_inner_radius
    length = np.pi * (circuit.journal_outer_radius + circuit.journal_inner_radius) / 8.0
    permeability = mu_0 * circuit.relative_permeability
    tau = parameters.iron.journal_conductivity * permeability * depth**2
    highest = min(HIGHEST_FREQUENCY, 1.0 / (_STEPS_PER_PERIOD * parameters.integration.internal_step))
    slowest = np.pi**2 / tau
    frequency = np.geomspace(min(0.01 * slowest, highest), highest, 400)
    for terms in range(_MOST_TERMS + 1):
        rates = np.geomspace(slowest, max(1.1 * 2.0 * np.pi * highest, slowest), terms)
        weights, rest = _fit(rates, frequency, tau)
        used = weights > 0.0
        journal = SolidJournal(
            weights=weights[used],
            rates=rates[used],
            rest=rest,
            time_constant=tau,
            segment_reluctance=length / (permeability * depth * circuit.axial_length),
            highest_frequency=highest,
        )
        if np.abs(journal.error(frequency)).max() <= ACCURACY:
            return journal
    raise PlantError(
        f"diffusion into the solid journal with time constant {tau:g} s (iron.journal_conductivity, "
        f"magnetic_circuit.relative_permeability and journal radii) is not fitted within {100.0 * ACCURACY:g} % up to "
        f"{highest:g} Hz by {_MOST_TERMS} terms; allowed: a smaller time constant, or a longer "
        "integration.internal_step"
    )


def _fit(
    rates: NDArray[np.float64], frequency: NDArray[np.float64], time_constant: float
) -> tuple[NDArray[np.float64], float]:
    """Weights and rest that fit the diffusion with the smallest sum of squares of the relative error."""
    s = 2j * np.pi * frequency[:, None]
    wanted = diffusion(frequency, time_constant)
    columns = np.hstack([s / (s + rates), s]) / wanted[:, None]
    matrix = np.vstack([columns.real, columns.imag])
    scale = np.linalg.norm(matrix, axis=0)
    target = (wanted - 1.0) / wanted
    coefficients = nnls(matrix / scale, np.concatenate([target.real, target.imag]))[0] / scale
    return coefficients[:-1], float(coefficients[-1])

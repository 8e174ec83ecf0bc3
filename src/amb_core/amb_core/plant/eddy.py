"""Eddy currents: diffusion into iron as few terms for the kernel, and the force bandwidth in closed form.

A flux that flows along a slab of permeability mu and conductivity sigma enters it by diffusion. Driven from one face, a
segment of length l, depth D and section A has the magnetomotive force (s the Laplace variable)

    R u coth(u) phi,    R = l / (mu A),    u = sqrt(s tau),    tau = sigma mu D^2

A lamination of thickness d is driven from both faces, so D = d / 2. Below 1 / (2 pi tau), 517 Hz for the paper's
bearing, u coth(u) ~ 1 + s tau / 3 gives the eddy coefficient sigma d^2 l / (12 A) of `amb_core.plant.network`: thin
laminations. Above, the drop rises with the square root of s only, as it does in a solid journal, which is centimetres
deep and has a tau of seconds. That needs additional states: the terms of a fit.

Sources: Lammeraner, Stafl, "Eddy Currents", Iliffe 1966 (lamination, tanh); Bertotti, "Hysteresis in Magnetism",
Academic Press 1998, ch. 12 (skin effect and loss of laminations); Stoll, "The Analysis of Eddy Currents", Oxford 1974
(slab); Meeker, Maslen, Noh, "Augmented circuit model for
magnetic bearings including eddy currents, fringing, and leakage", IEEE Trans. Magn. 32 (1996); Zhu, Knospe, Maslen,
"Analytic model for a nonlaminated cylindrical magnetic actuator including eddy currents", IEEE Trans. Magn. 41 (2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant.memory_terms import MOST_TERMS, MemoryTerms, fit_weights
from amb_core.plant.parameters import PlantParameters

ACCURACY = 0.005
"""Largest relative error of the terms' complex response up to their highest frequency (0.005 rad is 0.29 deg)."""
HIGHEST_FREQUENCY = 100e3
"""Highest frequency up to which the terms of a solid journal are fitted (Hz)."""
HIGHEST_FREQUENCY_OF_LAMINATIONS = 1e6
"""Highest frequency up to which the terms of laminations are fitted (Hz)."""
_STEPS_PER_PERIOD = 60  # internal steps per period of the highest frequency: keeps the shortest time constant at two
_FASTEST = 1.6  # fastest rate over the highest angular frequency


@dataclass(frozen=True)
class DiffusionTerms(MemoryTerms):
    """Diffusion into iron as a passive sum: u coth(u) ~ 1 + sum_n c_n s / (s + p_n) + r s.

    Each term stores, for every pole, the lead of its flux: m_n = c_n (phi - q_n) with q_n' = p_n (phi - q_n).
    With J the reluctance matrix of the iron, its drops are

        J (phi + sum_n m_n + r dphi/dt)

    J r belongs to the constant eddy-current matrix. m_n is zero at rest. A term stores the energy m_n J m_n / (2 c_n)
    and loses the power p_n m_n J m_n / c_n. Over a step the terms are as stiff as the reluctance J (1 + sum_n c_n).

    Attributes
    ----------
    time_constant : float
        tau (s).
    highest_frequency : float
        The sum was fitted from 0 Hz up to this frequency (Hz).
    """

    time_constant: float
    highest_frequency: float

    def error(self, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Relative error at frequencies (Hz): real part of the magnitude, imaginary part of the phase (rad)."""
        return self.response(frequency) / diffusion(frequency, self.time_constant) - 1.0


def diffusion(frequency: NDArray[np.float64], time_constant: float) -> NDArray[np.complex128]:
    """Drop along a slab over that of constant flux, u coth(u) with u = sqrt(s tau).

    Parameters
    ----------
    frequency : ndarray
        Frequencies (Hz), 0 included.
    time_constant : float
        tau (s).
    """
    u = np.sqrt(2j * np.pi * np.asarray(frequency, dtype=np.float64) * time_constant)
    at_rest = u == 0.0
    return np.where(at_rest, 1.0, u / np.tanh(np.where(at_rest, 1.0, u)))


def solid_journal_terms(parameters: PlantParameters) -> DiffusionTerms:
    """Fit a solid journal by the smallest number of terms with the required accuracy.

    A higher highest frequency makes r smaller. r / (1 + sum_n c_n), about 0.035 over the highest frequency, is the
    shortest time constant that the journal can give to the magnetic circuit. It must last two internal steps, so a
    period of the highest frequency has 60 internal steps: 33 kHz for 0.5 us, and at most 100 kHz. Above, the error
    grows slowly, to 10 % at 100 kHz. The force response is accurate to 0.3 %, its -3 dB frequency to 1 % because the
    slope there is flat.

    Parameters
    ----------
    parameters : PlantParameters
        Geometry, relative permeability, conductivity of the journal and internal step; `iron.solid_journal` itself is
        not used.

    Raises
    ------
    PlantError
        If 30 terms do not reach the accuracy.
    """
    tau = _journal_time_constant(parameters)
    highest = min(HIGHEST_FREQUENCY, 1.0 / (_STEPS_PER_PERIOD * parameters.integration.internal_step))
    terms = _fitted_terms(tau, highest)
    if terms is None:
        raise PlantError(
            f"diffusion into the solid journal with time constant {tau:g} s (iron.journal_conductivity, "
            f"magnetic_circuit.relative_permeability and journal radii) is not fitted within {100.0 * ACCURACY:g} % up "
            f"to {highest:g} Hz by {MOST_TERMS} terms; allowed: a smaller time constant, or a longer "
            "integration.internal_step"
        )
    return terms


def lamination_terms(parameters: PlantParameters) -> DiffusionTerms:
    """Fit the laminations by the smallest number of terms with the required accuracy up to 1 MHz.

    The integrator takes means over its steps (`DiffusionTerms.mean`), so the terms may be faster than a step. Above
    1 MHz the error of the paper's bearing is 3 % at 2 MHz, 17 % at 5 MHz and 37 % at 10 MHz, in magnitude and phase
    together; the magnitude alone is up to 11 % too small below 10 MHz. Far above, it rises as r s instead of the square
    root of s, and is too large.

    Parameters
    ----------
    parameters : PlantParameters
        Thickness and conductivity of the laminations and relative permeability; `iron.laminations` itself is not used.

    Raises
    ------
    PlantError
        If 30 terms do not reach the accuracy.
    """
    tau = lamination_time_constant(parameters)
    terms = _fitted_terms(tau, HIGHEST_FREQUENCY_OF_LAMINATIONS)
    if terms is None:
        raise PlantError(
            f"diffusion into laminations with time constant {tau:g} s (magnetic_circuit.lamination_thickness, "
            f"iron_conductivity and relative_permeability) is not fitted within {100.0 * ACCURACY:g} % up to "
            f"{HIGHEST_FREQUENCY_OF_LAMINATIONS:g} Hz by {MOST_TERMS} terms; allowed: a smaller time constant"
        )
    return terms


def force_response(parameters: PlantParameters, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Force on the centred, held rotor per control current along an axis, small signals about the bias (N/A).

    Opposite electromagnets carry bias current plus and minus i. With N_p turns per pole and shared flux, their
    magnetomotive forces are sums of sin(theta) and sin(3 theta) over the poles; each of these mode shapes sees the
    segments of the rings in a proportion rho = 1 / (4 sin^2(k 22.5 deg)), k = 1 or 3, has the impedance

        Z_rho(s) = g_0 / (mu_0 A) + (R_pole + rho R_back) (1 + s t) + rho R_journal (1 + s t),  t = sigma mu d^2 / 12,

    and a part in the force, so that with rho = 1/2 for the bias flux itself

        k_i(s) = 4 cos(22.5 deg) N_p^2 i_0 / (mu_0 A Z_1/2(0)) sum_rho w_rho / Z_rho(s)
        (rho, w_rho) = (1 + 1/sqrt 2, 1 - 1/sqrt 2) and (1 - 1/sqrt 2, 1/sqrt 2)

    In separate circuits rho = 1/2 for all. Laminations into which flux diffuses, and a solid journal, have u coth(u) in
    place of 1 + s t.

    Parameters
    ----------
    parameters : PlantParameters
        Magnetic circuit, bias current and switches of the iron, whose permeability is constant here.
    frequency : ndarray
        Frequencies (Hz).

    Raises
    ------
    PlantError
        If electromagnets share flux and not all of them carry the bias current.
    """
    circuit, iron = parameters.magnetic_circuit, parameters.iron
    if circuit.coupling and circuit.actuators != "two_axis":
        raise PlantError(
            f"magnetic_circuit.actuators = '{circuit.actuators}' with coupling has no closed form of the force "
            "response; allowed: two_axis, or coupling: false"
        )
    area = circuit.pole_width * circuit.axial_length
    permeability = mu_0 * circuit.relative_permeability
    gap = circuit.air_gap / (mu_0 * area)
    pole = (circuit.back_iron_inner_radius - circuit.pole_radius) / (permeability * area)
    back, journal = (
        np.pi * (outer + inner) / 8.0 / (permeability * (outer - inner) * circuit.axial_length)
        for inner, outer in (
            (circuit.back_iron_inner_radius, circuit.stator_outer_radius),
            (circuit.journal_inner_radius, circuit.journal_outer_radius),
        )
    )
    lag = circuit.iron_conductivity * permeability * circuit.lamination_thickness**2 / 12.0 if iron.eddy_currents else 0
    laminated = np.asarray(1.0 + 2j * np.pi * np.asarray(frequency, dtype=np.float64) * lag, dtype=np.complex128)
    if iron.laminations == "diffusion":
        laminated = diffusion(frequency, lamination_time_constant(parameters))
    in_journal = diffusion(frequency, _journal_time_constant(parameters)) if iron.solid_journal else laminated

    modes = ((1.0 + 0.5**0.5, 1.0 - 0.5**0.5), (1.0 - 0.5**0.5, 0.5**0.5)) if circuit.coupling else ((0.5, 1.0),)
    bias_flux = circuit.turns_per_pole * parameters.amplifier.bias_current / (gap + pole + 0.5 * (back + journal))
    admittance = sum(
        weight / (gap + (pole + share * back) * laminated + share * journal * in_journal) for share, weight in modes
    )
    return 4.0 * np.cos(np.pi / 8) * circuit.turns_per_pole * bias_flux / (mu_0 * area) * admittance


def eddy_bandwidth(parameters: PlantParameters) -> float:
    """Frequency at which eddy currents have lowered the force per control current by 3 dB (Hz); inf without them.

    In separate laminated circuits this is R / (2 pi K), with R the reluctance and K the eddy coefficient of a pole and
    its part of the rings. Otherwise it is found numerically from `force_response`.
    """
    from scipy.optimize import brentq  # takes a quarter of a second to import

    if not parameters.iron.eddy_currents:
        return math.inf

    def above(frequency: float) -> float:
        constant, varying = np.abs(force_response(parameters, np.array([0.0, frequency])))
        return float(varying / constant) - 0.5**0.5

    upper = 1e-6
    while above(upper) > 0.0:
        upper *= 10.0
    return float(brentq(above, 0.1 * upper, upper, xtol=1e-12 * upper, rtol=1e-12))


def lamination_time_constant(parameters: PlantParameters) -> float:
    """Time constant tau of the diffusion into a lamination, from both of its faces (s)."""
    circuit = parameters.magnetic_circuit
    return circuit.iron_conductivity * mu_0 * circuit.relative_permeability * (0.5 * circuit.lamination_thickness) ** 2


def _journal_time_constant(parameters: PlantParameters) -> float:
    """Time constant tau of the diffusion into a solid journal (s)."""
    circuit = parameters.magnetic_circuit
    depth = circuit.journal_outer_radius - circuit.journal_inner_radius
    return parameters.iron.journal_conductivity * mu_0 * circuit.relative_permeability * depth**2


def _fitted_terms(time_constant: float, highest: float) -> DiffusionTerms | None:
    """The smallest number of terms with the required accuracy; None if the largest number is not enough.

    Rates are spaced logarithmically from the slowest mode of diffusion, pi^2 / tau, to just above the highest
    frequency or the third mode; the weights follow by non-negative least squares of the relative error, so the sum is
    passive.
    """
    slowest = np.pi**2 / time_constant
    fastest = max(_FASTEST * 2.0 * np.pi * highest, 9.0 * slowest)  # the third mode has the rate 9 pi^2 / tau
    frequency = np.geomspace(min(0.01 * slowest, highest), highest, 400)
    for number in range(MOST_TERMS + 1):
        rates = np.geomspace(slowest, fastest, number)
        weights, rest = fit_weights(rates, frequency, diffusion(frequency, time_constant))
        used = weights > 0.0
        terms = DiffusionTerms(
            weights=weights[used],
            rates=rates[used],
            rest=rest,
            time_constant=time_constant,
            highest_frequency=highest,
        )
        if rest > 0.0 and np.abs(terms.error(frequency)).max() <= ACCURACY:
            return terms
    return None

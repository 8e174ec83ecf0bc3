"""Thrust bearing: magnetic circuit of its two ring magnets, their eddy currents, and its closed forms.

The magnet on the side of +z has the gap g_0 - z, the other one g_0 + z. Flux phi passes the gap at the inner and at the
outer ring pole (areas A_i, A_o), so with N turns and a coil current i

    N i = [R(z) + R_s sqrt(s tau)] phi,    R(z) = (g_0 -+ z) / mu_0 (1 / A_i + 1 / A_o) + R_iron,    R_s = R(0)
    F = phi^2 / (2 mu_0) (1 / A_i + 1 / A_o)

Stator and disc are solid. At all but the lowest frequencies flux runs in a skin below the surfaces around the coil,
where a path of length l and width w has the magnetomotive force l / w sqrt(s sigma / mu) phi: the effective reluctance
rises as the square root of s, by R_s sqrt(s tau) = c sqrt(s) with

    c = sqrt(sigma / mu) sum of l / w = sqrt(sigma / mu) / (2 pi) [h / r_2 + h / r_3 + 2 ln(r_3 / r_2) + 2 P_i + 2 P_o]

over both walls (depth h, radii r_2 and r_3) and the bottom of the slot, the disc opposite the slot, and the faces of
stator and disc at the poles. There flux leaves through the gap, uniformly in this model, so the drop is the mean over
the flux: P_i is the integral of q^2 / r over the radii r_1 to r_2 of the inner pole, with q the share of the flux that
passes the surface at r, P_o that over the outer pole. That flux crowds at the edge of the slot at high frequency is
left out, and the sum of static and skin reluctance has too much lag where the skin is about as deep as the iron.

Sources: L. Zhu, C. R. Knospe, E. H. Maslen, "Analytic model for a nonlaminated cylindrical magnetic actuator including
eddy currents", IEEE Trans. Magn. 41 (2005) 1248-1258; C. R. Knospe, L. Zhu, "Performance limitations of non-laminated
magnetic suspension systems", IEEE Trans. Control Systems Technology 19 (2011) 327-336 (reluctance of half order); R. L.
Stoll, "The Analysis of Eddy Currents", Oxford 1974 (skin).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant.memory_terms import MOST_TERMS, MemoryTerms, fit_weights
from amb_core.plant.parameters import AmplifierParameters, PlantParameters
from amb_core.plant.thrust_parameters import ThrustBearingParameters

ACCURACY = 0.005
"""Largest relative error of the terms' complex reluctance up to their highest frequency (0.005 rad is 0.29 deg)."""
HIGHEST_FREQUENCY = 1e6
"""Highest frequency up to which the terms are fitted (Hz)."""
SIDES = (1.0, -1.0)
"""Direction of the pull of each magnet along z."""
_SLOWEST = 1e-5  # slowest rate times tau: sqrt(s tau) is then below the accuracy
_FASTEST = 3.0  # fastest rate over the highest angular frequency


@dataclass(frozen=True)
class ThrustCircuit:
    """Magnetic circuit of one of the magnets.

    Attributes
    ----------
    gap_reluctance : float
        Reluctance per air gap, (1 / A_i + 1 / A_o) / mu_0 (A/(Wb m)).
    iron_reluctance : float
        R_iron (A/Wb).
    lag : float
        tau (s); 0 without eddy currents.
    air_gap : float
        g_0 (m).
    turns : int
        N.
    pole_areas : tuple of float
        A_i, A_o (m^2).
    """

    gap_reluctance: float
    iron_reluctance: float
    lag: float
    air_gap: float
    turns: int
    pole_areas: tuple[float, float]

    @property
    def pull(self) -> float:
        """Force over the square of the flux (N/Wb^2)."""
        return 0.5 * self.gap_reluctance

    @property
    def centred_reluctance(self) -> float:
        """R_s: reluctance at rest of the centred disc (A/Wb)."""
        return self.gap_reluctance * self.air_gap + self.iron_reluctance

    def reluctances(self, z: float) -> NDArray[np.float64]:
        """Reluctances at rest of both magnets (A/Wb), shape (2,), with the disc at z (m)."""
        return self.gap_reluctance * (self.air_gap - np.array(SIDES) * z) + self.iron_reluctance

    def force(self, currents: NDArray[np.float64], z: float) -> float:
        """Force on the disc along z (N) of constant coil currents (A), shape (2,)."""
        flux = self.turns * np.asarray(currents) / self.reluctances(z)
        return float(self.pull * np.dot(SIDES, flux**2))

    def current_gain(self, bias_current: float) -> float:
        """k_i: force per control current, disc centred (N/A)."""
        return 4.0 * self.pull * self.turns**2 * bias_current / self.centred_reluctance**2

    def negative_stiffness(self, bias_current: float) -> float:
        """k_s: force per displacement, disc centred, away from the centre (N/m)."""
        flux = self.turns * bias_current / self.centred_reluctance
        return 4.0 * self.pull * flux**2 * self.gap_reluctance / self.centred_reluctance

    def force_response(self, bias_current: float, frequency: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Force on the centred, held disc per control current at frequencies (Hz): k_i / (1 + sqrt(s tau)) (N/A)."""
        return self.current_gain(bias_current) / half_order(frequency, self.lag)


def thrust_circuit(parameters: ThrustBearingParameters) -> ThrustCircuit:
    """The magnetic circuit of a thrust bearing."""
    r_1, r_2 = parameters.inner_radius, parameters.slot_inner_radius
    r_3, r_4 = parameters.slot_outer_radius, parameters.outer_radius
    inner, outer = np.pi * (r_2**2 - r_1**2), np.pi * (r_4**2 - r_3**2)
    gap_reluctance = (1.0 / inner + 1.0 / outer) / mu_0
    permeability, depth = mu_0 * parameters.relative_permeability, parameters.slot_depth
    # Along the poles, and between their middles in the stator behind the slot and in the disc
    across = np.log((r_3 + r_4) / (r_1 + r_2)) / (2.0 * np.pi)
    iron = depth / inner + depth / outer + across / parameters.back_thickness + across / parameters.disc_thickness
    iron_reluctance = iron / permeability
    skin = depth / r_2 + depth / r_3 + 2.0 * np.log(r_3 / r_2) + 2.0 * _face(r_1, r_2) + 2.0 * _face(r_4, r_3)
    slope = np.sqrt(parameters.conductivity / permeability) * skin / (2.0 * np.pi) if parameters.eddy_currents else 0.0
    return ThrustCircuit(
        gap_reluctance=float(gap_reluctance),
        iron_reluctance=float(iron_reluctance),
        lag=float((slope / (gap_reluctance * parameters.air_gap + iron_reluctance)) ** 2),
        air_gap=parameters.air_gap,
        turns=parameters.turns,
        pole_areas=(float(inner), float(outer)),
    )


def thrust_amplifier(parameters: PlantParameters) -> AmplifierParameters:
    """Amplifiers of the thrust bearing: those of the plant, with its own gains, bias current and current limit."""
    own = parameters.thrust_bearing
    return parameters.amplifier.model_copy(
        update={
            "proportional_gain": own.proportional_gain,
            "integral_gain": own.integral_gain,
            "bias_current": own.bias_current,
            "current_limit": own.current_limit,
            "carriers": "synchronous",
        }
    )


def holding_duty(parameters: PlantParameters, current: float) -> float:
    """Duty beyond one half that holds a constant coil current (A): that of the resistance and of the dead time."""
    amplifier, resistance = parameters.amplifier, parameters.thrust_bearing.coil_resistance
    return resistance * current / (2.0 * amplifier.supply_voltage) + amplifier.dead_time * amplifier.switching_frequency


def half_order(frequency: NDArray[np.float64], lag: float) -> NDArray[np.complex128]:
    """Effective reluctance over that at rest, 1 + sqrt(s tau), at frequencies (Hz)."""
    return np.asarray(1.0 + np.sqrt(2j * np.pi * np.asarray(frequency, dtype=np.float64) * lag))


def half_order_terms(lag: float) -> MemoryTerms:
    """Fit 1 + sqrt(s tau) by the smallest number of terms with the required accuracy from 0 Hz to 1 MHz.

    Rates are spaced logarithmically (diffusive representation of the square root); the weights follow by non-negative
    least squares of the relative error, so the sum is passive.

    Raises
    ------
    PlantError
        If 30 terms do not reach the accuracy.
    """
    if lag == 0.0:
        return MemoryTerms(np.zeros(0), np.zeros(0), 0.0)
    fastest = _FASTEST * 2.0 * np.pi * HIGHEST_FREQUENCY
    slowest = min(_SLOWEST / lag, fastest)
    frequency = np.geomspace(0.1 * slowest / (2.0 * np.pi), HIGHEST_FREQUENCY, 400)
    wanted = half_order(frequency, lag)
    for number in range(1, MOST_TERMS + 1):
        rates = np.geomspace(slowest, fastest, number)
        weights, rest = fit_weights(rates, frequency, wanted)
        used = weights > 0.0
        terms = MemoryTerms(weights[used], rates[used], rest)
        if np.abs(terms.response(frequency) / wanted - 1.0).max() <= ACCURACY:
            return terms
    raise PlantError(
        f"the eddy currents of the thrust bearing with time constant {lag:g} s (thrust_bearing.conductivity and "
        f"relative_permeability) are not fitted within {100.0 * ACCURACY:g} % up to {HIGHEST_FREQUENCY:g} Hz by "
        f"{MOST_TERMS} terms; allowed: a smaller time constant"
    )


def _face(far: float, slot: float) -> float:
    """Integral of q^2 / r over a pole, from its radius far from the slot to that at the slot.

    q = (far^2 - r^2) / (far^2 - slot^2) is the flux that passes the surface at the radius r on its way to the slot.
    """
    whole = far**4 * np.log(slot / far) - far**2 * (slot**2 - far**2) + (slot**4 - far**4) / 4.0
    return float(abs(whole) / (far**2 - slot**2) ** 2)

"""What a bearing can do by the closed forms of its magnets, before anything is simulated.

Source: G. Schweitzer and E. H. Maslen (eds.), Magnetic Bearings, Springer, 2009, chapters 3 and 4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.constants import mu_0

from amb_core.ground.errors import PlantError
from amb_core.plant import PlantParameters
from amb_core.plant.closed_forms import current_gain, inductance, negative_stiffness
from amb_core.plant.voltage import largest_mean_voltage

HIGHEST_BIAS = 1.0
"""Mean flux density of the bias (T) beyond which little is left for control, below the saturation of the steel."""
LARGEST_RIPPLE = 0.2
"""Ripple of a coil current, of its bias current, that is worth a remark."""
FEWEST_SAMPLES = 10.0
"""Samples in the time constant of the unstable pole; fewer are worth a remark."""
LEAST_BANDWIDTH = 3.0
"""Bandwidth of the current loop over the unstable pole; less is worth a remark."""


@dataclass(frozen=True)
class Sizing:
    """Closed forms of one radial bearing with its rotor at the centre.

    Attributes
    ----------
    bias_flux_density, largest_flux_density : float
        In the air gaps at bias current, and at the limit of the coil current (T).
    load_ratio : float
        Force along an axis at the limit of the control current over the weight (-); infinite without weight.
    unstable_pole : float
        sqrt(k_s / m) (1/s).
    samples : float
        Of the controller, in the time constant of the unstable pole (-).
    force_slew : float
        Change of the force at the largest duty cycle d, k_i V (2 d - 1) / L (N/s).
    current_ripple : float
        Of a coil current, peak to peak at zero mean voltage, V / (2 L f) (A).
    current_bandwidth : float
        Of the current loop, 2 V K_P / L (rad/s) as a frequency (Hz).
    bias_current : float
        (A).
    """

    bias_flux_density: float
    largest_flux_density: float
    load_ratio: float
    unstable_pole: float
    samples: float
    force_slew: float
    current_ripple: float
    current_bandwidth: float
    bias_current: float

    @property
    def remarks(self) -> list[str]:
        """What is little or much, and what would do."""
        remarks = []
        if self.current_ripple > LARGEST_RIPPLE * self.bias_current:
            remarks.append(
                f"the current ripple of {self.current_ripple:.3g} A is more than {100 * LARGEST_RIPPLE:.0f} % of the "
                "bias current: a higher switching frequency, more turns or a lower voltage reduce it"
            )
        if self.samples < FEWEST_SAMPLES:
            remarks.append(
                f"the unstable pole leaves {self.samples:.2g} samples to respond, {FEWEST_SAMPLES:g} are usual: a "
                "higher sample rate gives more, and so does a smaller bias current"
            )
        if 2.0 * math.pi * self.current_bandwidth < LEAST_BANDWIDTH * self.unstable_pole:
            remarks.append(
                f"the current loop ({self.current_bandwidth:.3g} Hz) is hardly faster than the unstable pole "
                f"({self.unstable_pole:.3g} 1/s): a higher switching frequency makes it faster, as far as the eddy "
                "currents of a narrow gap permit"
            )
        return remarks


def sizing_of(parameters: PlantParameters) -> Sizing:
    """Closed forms of the bearing of a plant that carries one point mass."""
    circuit, amplifier, rotor = parameters.magnetic_circuit, parameters.amplifier, parameters.rotor
    bias, voltage = amplifier.bias_current, amplifier.supply_voltage
    gain, coil = current_gain(circuit, bias), inductance(circuit)
    density = mu_0 * circuit.turns_per_pole / circuit.air_gap  # T/A: two poles with their gaps in series
    force, weight = gain * (amplifier.current_limit - bias), rotor.mass * rotor.gravity
    pole = math.sqrt(negative_stiffness(circuit, bias) / rotor.mass)
    return Sizing(
        density * bias,
        density * amplifier.current_limit,
        force / weight if weight else math.inf,
        pole,
        parameters.integration.sample_rate / pole,
        gain * largest_mean_voltage(parameters) / coil,
        voltage / (2.0 * coil * amplifier.switching_frequency),
        2.0 * voltage * amplifier.proportional_gain / coil / (2.0 * math.pi),
        bias,
    )


def require_flux(parameters: PlantParameters) -> Sizing:
    """The closed forms of a bearing whose iron has flux left to control.

    Raises
    ------
    PlantError
        If the bias alone saturates the iron.
    """
    sizing = sizing_of(parameters)
    if sizing.bias_flux_density > HIGHEST_BIAS:
        share = HIGHEST_BIAS / sizing.bias_flux_density
        circuit = parameters.magnetic_circuit
        raise PlantError(
            f"bias flux density of {sizing.bias_flux_density:.3g} T: electrical steel saturates near 1.5 T, and "
            f"nothing is left for control; allowed: up to {HIGHEST_BIAS:g} T, with a bias current of "
            f"{share * sizing.bias_current:.3g} A, {max(math.floor(share * circuit.turns_per_pole), 1)} turns or a gap "
            f"of {1e3 * circuit.air_gap / share:.3g} mm"
        )
    return sizing

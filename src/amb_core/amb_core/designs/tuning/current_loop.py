"""Gains of the current loops of a bearing: the paper's, scaled, and less where the sampled loop would lack margin.

An amplifier sets its duty cycle once per switching period T from the mean current of the period before, and holds it.
With inductance L, supply voltage U and K_P, the loop gain of a period is

    g = 2 U K_P T / L

K_P gives it the value of the paper's loop. Eddy currents let a part of the coil current follow the voltage at once: in
a narrow gap or with fast switching this part makes the same g unstable. Then g is reduced until the loop stays stable
with `GAIN_MARGIN` times its gains, the rotor held in the centre.

K_I is the same part of K_P in a switching period as in the paper's loop, which hardly integrates. Where the coil
resistance R would keep more than `LARGEST_ERROR` of a current away, K_I = K_P R / L cancels the pole of the coil.

Source: D. M. Van de Sype et al., Small-signal Laplace-domain analysis of uniformly-sampled pulse-width modulators,
IEEE PESC 2004 (held duty cycles as sample and hold).
"""

from __future__ import annotations

import math

import numpy as np

from amb_core.ground.errors import PlantError
from amb_core.plant import Plant, PlantParameters
from amb_core.plant.averaged import AveragedPlant
from amb_core.plant.closed_forms import inductance
from amb_core.plant.differences import OpenPlant, open_plant
from amb_core.plant.operating_point import OperatingPoint
from amb_core.plant.parameters import AmplifierParameters, MagneticCircuitParameters
from amb_core.plant.sampled_amplifiers import switching_period_matrix

_PAPER = AmplifierParameters()
PERIOD_GAIN = (
    2.0
    * _PAPER.supply_voltage
    * _PAPER.proportional_gain
    / (inductance(MagneticCircuitParameters()) * _PAPER.switching_frequency)
)
"""Loop gain g of a switching period of the paper's current loop (-)."""
INTEGRAL_SHARE = _PAPER.integral_gain / (_PAPER.proportional_gain * _PAPER.switching_frequency)
"""K_I T / K_P of the paper's current loop (-)."""
GAINS = "amplifier.proportional_gain", "amplifier.integral_gain"
"""Names of the parameters K_P and K_I."""
GAIN_MARGIN = 2.0
"""Factor on K_P and K_I with which the loop must still be stable; the paper's has 3.5."""
LARGEST_ERROR = 0.01
"""Part of a current that the resistance may keep away from a loop that hardly integrates."""
HIGHEST_GAINS = 1e3, 1e6
"""K_P (1/A) and K_I (1/(A s)) that amplifiers take."""
_LESS = 0.95
_LEAST = 1e-4  # of the paper's loop gain
_ROUNDING = 1e-9  # of a pole at 1, which the integral part has with little resistance


class CurrentLoop:
    """The current loops of all electromagnets of a machine about bias current, its rotor held in the centre.

    Parameters
    ----------
    plant : Plant
        Gives the parameters; its state is neither used nor changed.
    """

    def __init__(self, plant: Plant) -> None:
        self._parameters = plant.parameters
        averaged = AveragedPlant(plant)
        references = np.zeros(2 * plant.bearings)
        rotor = np.zeros(averaged.coordinates.stop - averaged.coordinates.start)
        point = OperatingPoint(averaged.at_rest(rotor, references), references, references)
        self._opened = _held(open_plant(plant, point))

    def radius(self, proportional: float, integral: float) -> float:
        """Largest magnitude of a pole from switching period to switching period (-), for K_P (1/A), K_I (1/(A s))."""
        gains = {"proportional_gain": proportional, "integral_gain": integral}
        amplifier = self._parameters.amplifier.model_copy(update=gains)
        parameters = self._parameters.model_copy(update={"amplifier": amplifier})
        return float(np.abs(np.linalg.eigvals(switching_period_matrix(self._opened, parameters))).max())

    def stable(self, proportional: float, integral: float) -> bool:
        """Whether the loop is stable with these gains, and with `GAIN_MARGIN` times these."""
        return all(
            self.radius(factor * proportional, factor * integral) < 1.0 + _ROUNDING for factor in (1.0, GAIN_MARGIN)
        )


def current_loop_gains(parameters: PlantParameters) -> tuple[float, float]:
    """K_P (1/A) and K_I (1/(A s)) of the current loops of a bearing; its own gains are not used.

    Raises
    ------
    PlantError
        If no such gains make stable current loops.
    """
    loop = CurrentLoop(Plant(parameters))
    share = 1.0
    while share > _LEAST:
        gains = _scaled(parameters, share)
        if loop.stable(*gains):
            return gains
        share *= _LESS
    raise PlantError(
        f"the amplifiers' current loops are unstable with any gains, switching at "
        f"{parameters.amplifier.switching_frequency:g} Hz: the iron takes the field of the pulses away; a wider gap or "
        "a lower switching frequency makes them stable"
    )


def _scaled(parameters: PlantParameters, share: float) -> tuple[float, float]:
    """Gains for a part of the paper's loop gain, of four digits."""
    amplifier, circuit = parameters.amplifier, parameters.magnetic_circuit
    frequency, voltage, resistance = amplifier.switching_frequency, amplifier.supply_voltage, circuit.coil_resistance
    coil = inductance(circuit)
    proportional = rounded(share * PERIOD_GAIN * coil * frequency / (2.0 * voltage))
    proportional = min(proportional, HIGHEST_GAINS[0])
    corner = INTEGRAL_SHARE * frequency
    if resistance > LARGEST_ERROR * (2.0 * voltage * proportional + resistance):
        corner = max(corner, resistance / coil)
    return proportional, min(rounded(corner * proportional), HIGHEST_GAINS[1])


def rounded(value: float, digits: int = 4) -> float:
    """To significant digits, so that files can be read."""
    return round(value, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0.0


def _held(opened: OpenPlant) -> OpenPlant:
    """The open plant without the motion of the rotor: fluxes and their memories alone."""
    kept = [n for n, name in enumerate(opened.states) if name.startswith(("flux", "circulating", "memory"))]
    return OpenPlant(
        opened.a[np.ix_(kept, kept)],
        opened.b[kept],
        opened.c[:, kept],
        opened.d,
        opened.sensors[:, kept],
        [opened.states[n] for n in kept],
        opened.coils,
    )

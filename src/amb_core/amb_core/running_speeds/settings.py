"""Settings of the experiments over running speeds, and what they are by default for a machine.

The excitation is that of the demo: an orthogonal multisine of odd lines. The current that a line costs grows with
amplitude a and frequency f as a f^2. Where the rotor sags, the square of the currents acts as a force, so the motion at
low lines, which grows with a, is distorted in the ratio a f^4 of the highest line. The default amplitude keeps this.
"""

from __future__ import annotations

from pydantic import model_validator

from amb_core.excitation import Multisine
from amb_core.loop.machine import Machine
from amb_core.parameters import Parameters, quantity
from amb_core.plant import ModalData, PlantParameters

BAND_END = 600.0  # Hz, enough for rigid rotors
AMPLITUDE = 1.5e-6  # m, over a band to 600 Hz
ABOVE_BENDING = 1.3  # end of the band over the frequency of the highest bending mode
HIGHEST = 0.2  # end of the band over the sample rate, beyond which bending modes are left out


class SpeedSettings(Parameters):
    """Settings of each experiment; 0 for what follows from the machine."""

    amplitude: float = quantity(
        0.0, "m", "peak amplitude of the multisine; 0: 1.5 um for a band to 600 Hz, less for a wider one", 0.0, 1e-3
    )
    frequency_start: float = quantity(2.0, "Hz", "lower end of its band", 1e-3, 50e3)
    frequency_end: float = quantity(
        0.0, "Hz", "upper end of its band; 0: 600 Hz, or 1.3 times the highest bending frequency", 0.0, 50e3
    )
    period: float = quantity(0.5, "s", "period of the multisine", 0.01, 60.0)
    periods: int = quantity(2, "-", "periods of each of its experiments", 1, 100)
    settling: float = quantity(0.2, "s", "time before the multisine, in which the rotor settles", 0.0, 60.0)
    order: int = quantity(
        0, "-", "order of the models; 0: two states for every mode in the band and one for each axis", 0, 40
    )

    @model_validator(mode="after")
    def _band_is_not_empty(self) -> SpeedSettings:
        if 0.0 < self.frequency_end <= self.frequency_start:
            raise ValueError(
                f"the band {self.frequency_start:g} Hz to {self.frequency_end:g} Hz is empty; frequency_start must be "
                "below frequency_end"
            )
        return self

    def band_end(self, plant: PlantParameters) -> float:
        """Upper end of the band for a machine (Hz)."""
        if self.frequency_end:
            return self.frequency_end
        limit = HIGHEST * plant.integration.sample_rate
        bending = [ABOVE_BENDING * value for value in _frequencies(plant) if ABOVE_BENDING * value <= limit]
        return min(limit, max([BAND_END, *bending]))

    def multisine(self, plant: PlantParameters, machine: Machine) -> Multisine:
        """The excitation of a machine."""
        end = self.band_end(plant)
        axes = len(machine.axes)
        return Multisine(
            amplitude=self.amplitude or AMPLITUDE * min(1.0, (BAND_END / end) ** 4),
            axes="orthogonal",
            duration=axes * self.periods * self.period,
            periods=self.periods,
            frequency_start=self.frequency_start,
            frequency_end=end,
            phasing="optimised",
            odd=True,  # distortions of even order, which sag causes, then lie between the lines
        )

    def model_order(self, plant: PlantParameters, axes: int) -> int:
        """Order of the models that the settings ask for; data may determine less."""
        modes = sum(value <= self.band_end(plant) for value in _frequencies(plant))
        return self.order or min(2 * modes + axes, 40)


def _frequencies(plant: PlantParameters) -> list[float]:
    """Natural frequencies of the free rotor (Hz): 0 for rigid body modes."""
    if plant.rotor.model != "flexible":
        return [0.0] * (2 if plant.rotor.model == "point_mass" else 4)
    return [float(value) for value in ModalData.load(plant.flexible_rotor.modal_data).natural_frequencies]

"""Settings of the experiments over running speeds; by default those that follow from the machine."""

from __future__ import annotations

from pydantic import model_validator

from amb_core.excitation import Multisine
from amb_core.ground.parameters import Parameters, quantity
from amb_core.loop.machine import Machine
from amb_core.plant import PlantParameters
from amb_core.rig import machine_experiment
from amb_core.rig.machine_experiment import LOWEST, PERIOD, PERIODS


class SpeedSettings(Parameters):
    """Settings of each experiment; 0 for what follows from the machine, as `amb_core.rig.machine_experiment` has it."""

    amplitude: float = quantity(
        0.0, "m", "peak amplitude of the multisine; 0: 1.5 um for a band to 600 Hz, less for a wider one", 0.0, 1e-3
    )
    frequency_start: float = quantity(LOWEST, "Hz", "lower end of its band", 1e-3, 50e3)
    frequency_end: float = quantity(
        0.0, "Hz", "upper end of its band; 0: 600 Hz, or more for bending modes or a thrust bearing", 0.0, 50e3
    )
    period: float = quantity(PERIOD, "s", "period of the multisine", 0.01, 60.0)
    periods: int = quantity(PERIODS, "-", "periods of each of its experiments", 1, 100)
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

    def multisine(self, plant: PlantParameters, machine: Machine) -> Multisine:
        """The excitation of a machine.

        Parameters
        ----------
        plant : PlantParameters
            Parameters of the machine, for the highest frequency of its modes.
        machine : Machine
            Its axes.

        Returns
        -------
        Multisine
            The excitation.
        """
        end = self.frequency_end or machine_experiment.band_end(plant)
        return machine_experiment.multisine(
            machine,
            end,
            self.amplitude or machine_experiment.amplitude(end),
            band_start=self.frequency_start,
            period=self.period,
            periods=self.periods,
        )

    def model_order(self, plant: PlantParameters) -> int:
        """Order of the models that the settings ask for; data may determine less.

        Parameters
        ----------
        plant : PlantParameters
            The machine.

        Returns
        -------
        int
            Number of states.
        """
        return self.order or machine_experiment.model_order(plant, self.frequency_end)

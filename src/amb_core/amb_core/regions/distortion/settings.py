"""Settings of a distortion measurement."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from amb_core.excitation.deterministic import HIGHEST_FREQUENCY
from amb_core.ground.parameters import Parameters, choice, quantity

FEWEST_LINES = 8  # of the odd ones in the band, so that some are excited and some are not in every part of it


class DistortionSettings(Parameters):
    """Random-phase odd multisines with detection lines, on both axes at once or on one after the other.

    Each realisation has new random phases and two experiments, which together separate the responses to the two
    references: with both axes excited the second one has the opposite sign on y; in turn, the first excites x and the
    second y.
    """

    rms: float = quantity(
        2e-6, "m", "root mean square of the reference on each axis; its peak is 3 to 4 times", 1e-9, 1e-3
    )
    frequency_start: float = quantity(1.0, "Hz", "lower end of the band", 1e-3, HIGHEST_FREQUENCY)
    frequency_end: float = quantity(500.0, "Hz", "upper end of the band", 1e-3, HIGHEST_FREQUENCY)
    period: float = quantity(1.0, "s", "period of the multisine; its inverse is the distance of the lines", 1e-3, 100.0)
    periods: int = quantity(2, "-", "periods that are measured in each experiment; they show the noise", 2, 1000)
    settling_periods: int = quantity(1, "-", "periods before those, in which transients die down", 1, 1000)
    realisations: int = quantity(4, "-", "realisations of the random phases", 2, 1000)
    group: int = quantity(4, "-", "consecutive odd lines of which one, drawn by lot, is not excited", 2, 100)
    seed: int = quantity(1, "-", "seed of the phases and of the lines that are not excited", 0, 2**31 - 1)
    axes: Literal["both", "in_turn"] = choice("both", "axes that are excited in an experiment: both, or one in_turn")
    rest: float = quantity(0.5, "s", "time before the excitation, in which the rotor settles", 0.0, 60.0)

    @model_validator(mode="after")
    def _band_has_lines(self) -> Self:
        least = self.frequency_start + (2 * FEWEST_LINES) / self.period
        if self.frequency_end < least:
            raise ValueError(
                f"the band from {self.frequency_start:g} to {self.frequency_end:g} Hz has too few lines at a distance "
                f"of {1.0 / self.period:g} Hz; allowed: frequency_end of at least {least:g} Hz, or a longer period"
            )
        return self

"""Settings of a region map: which sweeps and amplitudes, how finely boundaries are resolved, how they are confirmed."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import model_validator

from amb_core.excitation import Sweep
from amb_core.ground.parameters import Parameters, choice, declarations, quantity


class MapSettings(Parameters):
    """Settings of a region map; the sweep on y is by default that which the paper states for its Fig. 5."""

    amplitude_low: float = quantity(5e-6, "m", "smallest amplitude", 1e-9, 1e-3)
    amplitude_high: float = quantity(100e-6, "m", "largest amplitude", 1e-9, 1e-3)
    frequency_start: float = quantity(10.0, "Hz", "frequency at which every sweep starts", 1e-3, 50e3)
    frequency_end: float = quantity(5000.0, "Hz", "frequency at which it ends unless the rotor delevitates", 1e-3, 50e3)
    spacing: Literal["linear", "logarithmic"] = choice("linear", "how the frequency runs over time")
    duration: float = quantity(20.0, "s", "duration of a sweep", 0.1, 600.0)
    rest: float = quantity(1.0, "s", "time at rest before it, in which the rotor settles", 0.0, 60.0)
    axes: str = choice(
        "y",
        "axes that are excited with the same signal: names joined with commas, a bearing (bearing_a), a rigid mode "
        "(translate_x, tilt_y), or all; x, y and both are those of the first bearing",
    )
    initial_sweeps: int = quantity(8, "-", "sweeps at amplitudes with equal ratios, before refinement", 2, 1000)
    max_sweeps: int = quantity(24, "-", "largest number of sweeps, refinement included", 2, 1000)
    resolution: float = quantity(
        0.03,
        "-",
        "relative error in frequency, or in amplitude where a boundary ends, down to which it is refined",
        1e-3,
        1.0,
    )

    @model_validator(mode="before")
    @classmethod
    def _few_sweeps_are_all_initial(cls, given: Any) -> Any:
        """`max_sweeps` alone is enough to request fewer sweeps than the default of `initial_sweeps`."""
        if not isinstance(given, dict) or "initial_sweeps" in given or not isinstance(given.get("max_sweeps"), int):
            return given
        return given | {"initial_sweeps": min(cls.model_fields["initial_sweeps"].default, max(given["max_sweeps"], 2))}

    @model_validator(mode="after")
    def _ranges_ascend(self) -> MapSettings:
        for quantity_, low, high, unit in (
            ("amplitude", self.amplitude_low, self.amplitude_high, "m"),
            ("frequency", self.frequency_start, self.frequency_end, "Hz"),
        ):
            if low >= high:
                ends = ("low", "high") if quantity_ == "amplitude" else ("start", "end")
                raise ValueError(
                    f"{quantity_}_{ends[0]} = {low:g} {unit} must be below {quantity_}_{ends[1]} = {high:g} {unit}"
                )
        if self.initial_sweeps > self.max_sweeps:
            raise ValueError(f"initial_sweeps = {self.initial_sweeps} must not exceed max_sweeps = {self.max_sweeps}")
        return self

    def sweep_rate(self, frequency: float) -> float:
        """Rate of the sweeps (Hz/s) at a frequency (Hz); that of a linear sweep is the same at all frequencies.

        Parameters
        ----------
        frequency : float
            Frequency (Hz).

        Returns
        -------
        float
            Rate (Hz/s).
        """
        if self.spacing == "linear":
            return (self.frequency_end - self.frequency_start) / self.duration
        return frequency * math.log(self.frequency_end / self.frequency_start) / self.duration

    def at_rate(self, factor: float) -> MapSettings:
        """The same settings with sweeps whose rate is multiplied by a factor, within the allowed durations.

        Parameters
        ----------
        factor : float
            Factor on the rate (-), positive.

        Returns
        -------
        MapSettings
            Settings with another duration.
        """
        allowed = next(item for item in declarations(MapSettings) if item.name == "duration")
        duration = min(max(self.duration / factor, allowed.minimum or 0.0), allowed.maximum or math.inf)
        return self.model_copy(update={"duration": duration})

    def sweep(self, amplitude: float) -> Sweep:
        """The sweep of one amplitude (m).

        Parameters
        ----------
        amplitude : float
            Amplitude (m).

        Returns
        -------
        Sweep
            The excitation.
        """
        return Sweep(
            amplitude=amplitude,
            duration=self.duration,
            axes=self.axes,
            frequency_start=self.frequency_start,
            frequency_end=self.frequency_end,
            spacing=self.spacing,
        )


class ConfirmationSettings(Parameters):
    """Settings of the confirmation of a region map: fixed sines (dwells), and sweeps at another rate."""

    dwell: float = quantity(
        4.0,
        "s",
        "time at the fixed frequency; a drift of 4/3 of the classifier's threshold within it counts as region B",
        1.0,
        600.0,
    )
    ramp: float = quantity(
        0.5,
        "s",
        "time of the smooth start of the amplitude, and then of the smooth change to the fixed frequency",
        0.05,
        60.0,
    )
    approach: float = quantity(
        1.2, "-", "ratio of the fixed frequency and the one at which the sine starts, below or above it", 1.01, 3.0
    )
    rate_factor: float = quantity(
        0.5, "-", "rate of the sweeps that are repeated, as a multiple of the rate of the map's sweeps", 0.02, 50.0
    )

"""Parameters of the region classifier: each a threshold or a time with a unit and a physical meaning."""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from amb_core.ground.errors import RegionError
from amb_core.ground.parameters import Parameters, quantity, validate

SMALLEST_RADIUS = 1e-6  # m
PER_INTERVAL = 10
"""Decimated samples of an update interval, and its fewest samples."""
LONGEST_INTERVAL = 0.1
"""Longest time from one classification to the next (s)."""
_TIMES = ("update_interval", "settling_time", "trend_window", "oscillation_window", "hold_time")


class RegionParameters(Parameters):
    """Parameters of the region classifier; the defaults suit a bearing whose loop has its poles near 60 Hz.

    Below 1 kHz the defaults are those of a loop as much slower; see `for_sample_time`.
    """

    backup_bearing_radius: float = quantity(
        0.0,
        "m",
        "radial position at or above which the rotor counts as delevitated (region D), in every radial bearing; 0: "
        "the clearance of each bearing as the machine describes it",
        0.0,
        1e-2,
    )
    update_interval: float = quantity(0.01, "s", "time from one classification to the next", 0.002, LONGEST_INTERVAL)
    settling_time: float = quantity(
        0.1,
        "s",
        "time for transients of a start or of another excitation to die down; nothing is classified during it",
        0.0,
        10.0,
    )
    false_alarm_rate: float = quantity(
        0.1, "1/h", "false alarms per hour and axis that noise alone may cause, for B and for C each", 1e-6, 1e3
    )
    running_speed: float = quantity(
        0.0,
        "rad/s",
        "known speed of the rotor, in rad/s (`rotor.running_speed` of the simulator is in Hz): lines at it and its "
        "harmonics count neither as drift nor as slow oscillation; 0: unknown, such lines are found while there is no "
        "excitation",
        0.0,
        1e5,
    )
    drift_threshold: float = quantity(
        4e-6,
        "m",
        "smallest change of the bias over the span of a trend test that counts as drift (region B)",
        1e-9,
        1e-3,
    )
    trend_window: float = quantity(
        0.24, "s", "shortest span of a trend test; the others span 2, 4, ... 32 times this", 0.12, 10.0
    )
    resonance_gain: float = quantity(
        0.7,
        "-",
        "response per input at or above which a changing bias is attributed to the resonance of the loop, not to "
        "drift; 0.7 is the edge of the loop's bandwidth",
        0.1,
        100.0,
    )
    oscillation_threshold: float = quantity(
        1e-6, "m", "smallest amplitude of a slow oscillation that counts (region C)", 1e-9, 1e-3
    )
    oscillation_window: float = quantity(
        0.2, "s", "length of the window that is searched for a slow oscillation", 0.05, 5.0
    )
    period_ratio: float = quantity(
        3.0, "-", "smallest ratio of the period of a slow oscillation to the period of the input", 1.5, 100.0
    )
    slow_frequency: float = quantity(
        150.0,
        "Hz",
        "highest frequency of a slow oscillation; about twice the natural frequency of the closed loop",
        5.0,
        5000.0,
    )
    beat_order: int = quantity(
        17, "-", "highest harmonic of the input that is checked for beating with the sample rate", 2, 40
    )
    beat_share: float = quantity(
        0.5, "-", "share of the power of a slow oscillation that beating must explain to count as its cause", 0.0, 1.0
    )
    hold_time: float = quantity(0.2, "s", "time without evidence after which a region is left", 0.0, 10.0)

    def for_sample_time(self, sample_time: float) -> Self:
        """These, with defaults for a slower loop where an update of the default interval holds fewer than ten samples.

        Parameters
        ----------
        sample_time : float
            Sample time of the data (s).

        Returns
        -------
        RegionParameters
            The same where an update holds ten samples. Otherwise all times that have their default are as much longer,
            and the highest frequency of slow oscillations as much lower.

        Raises
        ------
        RegionError
            If an update interval other than the default holds too few samples, or the sample rate is below 100 Hz.
        ParameterError
            If times other than the default do not fit.
        """
        factor = PER_INTERVAL * sample_time / self.update_interval
        if factor <= 1.0 + 1e-6:
            return self
        if PER_INTERVAL * sample_time > LONGEST_INTERVAL * (1.0 + 1e-6):
            raise RegionError(
                f"regions are not classified at {1.0 / sample_time:g} Hz; the sample rate must be at least "
                f"{PER_INTERVAL / LONGEST_INTERVAL:g} Hz"
            )
        default = type(self)()
        if self.update_interval != default.update_interval:
            raise RegionError(
                f"update_interval = {self.update_interval:g} s is too short for the sample time {sample_time:g} s; it "
                f"must hold at least {PER_INTERVAL} samples, {PER_INTERVAL * sample_time:g} s"
            )
        slower = {name: getattr(default, name) * factor for name in _TIMES}
        slower |= {"update_interval": PER_INTERVAL * sample_time, "slow_frequency": default.slow_frequency / factor}
        kept = {name: value for name, value in self.model_dump().items() if value != getattr(default, name)}
        return validate(type(self), slower | kept)

    @model_validator(mode="after")
    def _fits_together(self) -> RegionParameters:
        if 0.0 < self.backup_bearing_radius < SMALLEST_RADIUS:
            raise ValueError(
                f"backup_bearing_radius = {self.backup_bearing_radius:g} m must be 0 or at least {SMALLEST_RADIUS:g} m"
            )
        highest = 1.5 / self.update_interval
        if self.slow_frequency > highest:
            raise ValueError(
                f"slow_frequency = {self.slow_frequency:g} Hz must not exceed 1.5 / update_interval = {highest:g} Hz"
            )
        lowest = 6.0 / self.oscillation_window
        if self.slow_frequency < lowest:
            raise ValueError(
                f"slow_frequency = {self.slow_frequency:g} Hz must be at least "
                f"6 / oscillation_window = {lowest:g} Hz, or slow oscillations are not resolved"
            )
        for name, updates in (("trend_window", 12), ("oscillation_window", 10)):
            if getattr(self, name) < (updates - 1e-9) * self.update_interval:
                raise ValueError(
                    f"{name} = {getattr(self, name):g} s must be at least {updates} update intervals, "
                    f"{updates * self.update_interval:g} s"
                )
        return self

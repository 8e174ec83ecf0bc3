"""Protection on the host's side of a rig: excitations are checked before they reach the target.

The target checks amplitude and slew again, and everything that it measures, in every step.

Sources: ISO 14839-2 for the defaults of alarm and trip, the upper boundaries of its zones B and C, 0.4 and 0.5 of the
smallest clearance; to be checked against the standard itself.
"""

from __future__ import annotations

import math
from dataclasses import astuple

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from amb_core.ground.errors import ExcitationError, ParameterError
from amb_core.ground.parameters import Parameters, quantity
from amb_core.loop.machine import Machine
from amb_core.rig.link import Limits

OUT_OF_BAND = 0.01
"""Share of the power of an excitation that may lie outside the band: its steps from and to zero are never in it."""

LONGEST_FADE = 60.0  # s, of every target


class ProtectionParameters(Parameters):
    """Limits that the host sets; the target's own hold where they are lower."""

    excitation_amplitude: float = quantity(
        0.0, "m", "largest excitation; 0: the target's limit", 0.0, 1e-3, runtime=True
    )
    excitation_slew: float = quantity(
        0.0, "m/s", "fastest change of an excitation; 0: the target's limit", 0.0, 1000.0, runtime=True
    )
    lowest_frequency: float = quantity(0.0, "Hz", "lower end of the band of excitations", 0.0, 50_000.0)
    highest_frequency: float = quantity(
        0.0, "Hz", "upper end of the band of excitations; 0: half the sample rate", 0.0, 50_000.0
    )
    longest_excitation: float = quantity(
        0.0, "s", "longest excitation; 0: as long as the target has room for", 0.0, 86_400.0
    )
    alarm_share: float = quantity(
        0.4,
        "-",
        "radial displacement over clearance: alarm (zone boundary B/C after ISO 14839-2)",
        0.01,
        1.0,
        runtime=True,
    )
    trip_share: float = quantity(
        0.5,
        "-",
        "radial displacement over clearance: trip (zone boundary C/D after ISO 14839-2)",
        0.01,
        1.0,
        runtime=True,
    )

    @model_validator(mode="after")
    def _alarm_before_trip(self) -> ProtectionParameters:
        if self.alarm_share > self.trip_share:
            raise ValueError(
                f"alarm_share = {self.alarm_share:g} is above trip_share = {self.trip_share:g}; allowed: up to that; "
                "to raise both, raise trip_share first"
            )
        return self

    def require_no_looser(self, than: ProtectionParameters, when: str) -> None:
        """Check that none of these limits protects less than that of another set.

        Parameters
        ----------
        than : ProtectionParameters
            The other set.
        when : str
            When the other set holds, for the message.

        Raises
        ------
        ParameterError
            If one protects less.
        """
        for name in ("excitation_amplitude", "excitation_slew", "alarm_share", "trip_share"):
            value, limit = (getattr(limits, name) or math.inf for limits in (self, than))  # 0: the target's limit
            if value > limit:
                raise ParameterError(
                    f"'protection.{name}' = {getattr(self, name):g} protects less; allowed: up to {limit:g}, as {when}"
                )

    def lowered(self, of_target: Limits, current_limit: float) -> Limits:
        """The target's limits with these in their place where they are lower, and a limit of the current (A).

        Parameters
        ----------
        of_target : Limits
            Limits that the target has.
        current_limit : float
            Limit of the control currents (A).

        Returns
        -------
        Limits
            The limits to send to the target.
        """
        changed = {
            "control_current": current_limit,
            "alarm_share": self.alarm_share,
            "trip_share": self.trip_share,
            "excitation_amplitude": self.excitation_amplitude or math.inf,
            "excitation_slew": self.excitation_slew or math.inf,
        }
        own = dict(zip(Limits.__dataclass_fields__, astuple(of_target), strict=True))
        return Limits(**{name: min(value, changed.get(name, math.inf)) for name, value in own.items()})


class ExcitationProtection:
    """Checks excitations against the limits of a rig.

    Parameters
    ----------
    parameters : ProtectionParameters
        Band and length.
    limits : Limits
        Amplitude and slew.
    machine : Machine
        Its axes, its clearances and its sample rate.
    room : int
        Longest excitation that the target has room for, in steps.

    Attributes
    ----------
    fade_steps : int
        Steps for which an excitation that is stopped fades at least.
    """

    def __init__(self, parameters: ProtectionParameters, limits: Limits, machine: Machine, room: int) -> None:
        self._parameters, self._limits, self._machine = parameters, limits, machine
        self._axes, self._rate = machine.axis_names, machine.sample_rate
        self.fade_steps = math.ceil(min(limits.fade_time, LONGEST_FADE) * self._rate)
        wanted = parameters.longest_excitation
        self._steps, self._by = room, "room for it on the target"
        if wanted and round(wanted * self._rate) < room:
            self._steps, self._by = round(wanted * self._rate), "the limit longest_excitation"

    def require_length(self, steps: int) -> None:
        """Check the length of an excitation; needs no samples.

        Parameters
        ----------
        steps : int
            Its number of steps.

        Raises
        ------
        ExcitationError
            If it has more steps than allowed.
        """
        if steps > self._steps:
            raise ExcitationError(
                f"{steps / self._rate:g} s long; allowed on this rig: {self._steps / self._rate:g} s ({self._by})"
            )

    def require(self, samples: NDArray[np.float64], position: NDArray[np.float64]) -> None:
        """Raise ExcitationError unless an excitation is within all limits.

        Parameters
        ----------
        samples : ndarray, shape (steps, axes)
            The excitation (m).
        position : ndarray, shape (axes,)
            Where the rotor is without it (m).
        """
        self.require_length(len(samples))
        require_amplitude_and_slew(samples, self._limits, self._machine)
        self._require_band(samples)
        self._require_clearance(samples + position)

    def _require_clearance(self, positions: NDArray[np.float64]) -> None:
        """A rotor that follows exactly must stay below the alarm; if it overshoots, there is room up to the trip."""
        share = self._limits.alarm_share
        for bearing in self._machine.bearings:
            columns = self._machine.columns_of(bearing.name)
            farthest = float(np.sqrt((positions[:, columns] ** 2).sum(axis=1)).max())
            if not farthest <= share * bearing.clearance:  # nor where a position is not known
                raise ExcitationError(
                    f"from where the rotor is now it would go to {farthest * 1e6:.4g} um from the centre of bearing "
                    f"{bearing.name}; allowed on this rig: {share * bearing.clearance * 1e6:.4g} um, the alarm"
                )

    def _require_band(self, samples: NDArray[np.float64]) -> None:
        low = self._parameters.lowest_frequency
        high = self._parameters.highest_frequency or 0.5 * self._rate
        if low == 0.0 and high >= 0.5 * self._rate:
            return
        frequency = np.fft.rfftfreq(len(samples), 1.0 / self._rate)
        for column, axis in zip(samples.T, self._axes, strict=True):
            power = np.abs(np.fft.rfft(column)) ** 2
            total = power.sum()
            outside = power[(frequency < low) | (frequency > high)].sum()
            if outside > OUT_OF_BAND * total:
                raise ExcitationError(
                    f"{100 * outside / total:.3g} % of its power on {axis} lies outside of {low:g} to {high:g} Hz; "
                    f"allowed on this rig: {100 * OUT_OF_BAND:g} %"
                )


def require_amplitude_and_slew(samples: NDArray[np.float64], limits: Limits, machine: Machine) -> None:
    """Raise ExcitationError unless an excitation is within the limits that the target checks, too.

    Parameters
    ----------
    samples : ndarray, shape (steps, axes)
        The excitation (m).
    limits : Limits
        Amplitude and slew.
    machine : Machine
        Its axes and its sample rate.
    """
    slew = np.abs(np.diff(samples, axis=0, prepend=0.0, append=0.0)) * machine.sample_rate  # from and to zero, too
    for values, limit, what, scale, unit in (
        (np.abs(samples), limits.excitation_amplitude, "amplitude", 1e6, "um"),
        (slew, limits.excitation_slew, "slew", 1e3, "mm/s"),
    ):
        peaks = values.max(axis=0)
        worst = int(np.argmax(peaks))
        if peaks[worst] > limit:
            raise ExcitationError(
                f"{what} of {peaks[worst] * scale:.4g} {unit} on {machine.axis_names[worst]}; allowed on this rig: "
                f"{limit * scale:.4g} {unit}"
            )

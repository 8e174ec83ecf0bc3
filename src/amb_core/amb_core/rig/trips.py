"""Trips of a rig: each is reported once, with its text, when the telemetry before it is there."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from amb_core.loop.machine import Machine
from amb_core.rig.link import TargetStatus, Trip, TripReason


class BridgeTrip(IntEnum):
    """Reasons of the bridge's own, in addition to those of the target."""

    LINK_LOST = 100
    REBOOT = 101


_TEXTS: dict[int, str] = {
    TripReason.DISPLACEMENT: (
        "radial displacement at {axis}, or distance from its reference: {percent:.0f} % of the clearance"
    ),
    TripReason.SENSOR_RANGE: "position sensor {axis} out of range: {um:.4g} um",
    TripReason.SENSOR_STUCK: "position sensor {axis} stuck at {um:.4g} um",
    TripReason.OVER_CURRENT: "over-current in coil {number}: {value:.3g} A",
    TripReason.TEMPERATURE: "temperature: {value:.4g} deg C",
    TripReason.AMPLIFIER: "the amplifiers report a fault",
    TripReason.WATCHDOG: "watchdog: {value:.0f} control steps, or currents of the host, missed lately",
    TripReason.LAW: "control current of {axis} not finite",
    TripReason.HOST_SILENT: "no command of the host for {value:.0f} steps: the excitation fades, the rotor may land",
    TripReason.SATURATED: "control current of {axis} at its limit for too long: {value:.3g} A",
    TripReason.EXCITATION: "excitation of {axis} beyond a limit: {um:.4g} um; it fades, the loop stays",
    BridgeTrip.LINK_LOST: "the target does not answer; whether the rotor is levitated is not known",
    BridgeTrip.REBOOT: "the target started anew; the rotor is not levitated",
}
LOOP_STAYS = {TripReason.HOST_SILENT, TripReason.EXCITATION}
"""Reasons after which the rotor stays levitated."""
_OF_AN_AXIS = {
    TripReason.DISPLACEMENT, TripReason.SENSOR_RANGE, TripReason.SENSOR_STUCK, TripReason.LAW, TripReason.EXCITATION,
    TripReason.SATURATED,
}  # fmt: skip


def axis_of(trip: Trip, machine: Machine) -> str:
    """Name of the axis that a trip concerns; empty for none."""
    return machine.axis_names[trip.axis] if trip.reason in _OF_AN_AXIS and trip.axis < len(machine.axes) else ""


def describe(trip: Trip, machine: Machine) -> str:
    """A trip as text, without its step.

    Parameters
    ----------
    trip : Trip
        A latched trip.
    machine : Machine
        Machine of the target, for the names of its axes.

    Returns
    -------
    str
        One line of text.
    """
    words = {"percent": 1e2 * trip.value, "um": 1e6 * trip.value, "value": trip.value, "number": trip.axis + 1}
    return _TEXTS[trip.reason].format(axis=axis_of(trip, machine), **words)


@dataclass
class _Waiting:
    trip: Trip
    since: float


class TripLog:
    """Latched trips of a target, each new one once.

    Attributes
    ----------
    latched : list of Trip
        Those of the target at its latest status, in the order of their occurrence.
    """

    PATIENCE = 0.5  # s for which telemetry up to a trip is waited for; it may have been lost

    def __init__(self) -> None:
        self.latched: list[Trip] = []
        self._known: set[tuple[int, int]] = set()
        self._waiting: list[_Waiting] = []

    def note(self, status: TargetStatus, now: float) -> bool:
        """Take the trips of a status.

        Parameters
        ----------
        status : TargetStatus
            State of the target.
        now : float
            Time of a monotonic clock (s).

        Returns
        -------
        bool
            True if it has new trips.
        """
        self.latched = list(status.trips)
        new = [trip for trip in status.trips if (trip.reason, trip.step) not in self._known]
        self._known = {(trip.reason, trip.step) for trip in status.trips}
        self._waiting += [_Waiting(trip, now) for trip in new]
        return bool(new)

    def ready(self, next_target_step: int, now: float) -> list[Trip]:
        """Trips up to which telemetry has arrived, or that have waited long enough; each is returned once.

        Parameters
        ----------
        next_target_step : int
            Step of the target after the last one whose telemetry has arrived.
        now : float
            Time of the same clock as for `note` (s).

        Returns
        -------
        list of Trip
            Trips, oldest first.
        """
        done = [one for one in self._waiting
                if next_target_step >= one.trip.step or now - one.since > self.PATIENCE]  # fmt: skip
        self._waiting = [one for one in self._waiting if one not in done]
        return [one.trip for one in done]

"""`TargetLink`: what the hardware bridge needs of a connection to a real-time target, whatever its protocol.

AMB-UDP is one implementation (`amb_udp.AmbUdpLink`). Another one, for XCP, EtherCAT or a vendor's interface, is a
module of its own with a subclass; the bridge loads it by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import TargetError
from amb_core.loop.known_controller import KnownController
from amb_core.loop.machine import Machine
from amb_core.rig.link.answers import TargetStatus, TelemetryBlock
from amb_core.rig.link.in_order import TelemetryCount
from amb_core.rig.link.layout import Limits

WithoutHost = Literal["", "off", "land"]


class TooLateError(TargetError):
    """An excitation was armed for a step that has passed.

    Parameters
    ----------
    step : int
        The step for which it was armed.
    next_step : int
        The step of the target that came next.

    Attributes
    ----------
    next_step : int
        The step of the target that came next.
    """

    def __init__(self, step: int, next_step: int) -> None:
        super().__init__(f"step {step} of the target has passed; step {next_step} came next")
        self.next_step = next_step


class LevitatedError(TargetError):
    """Another host levitates the rotor."""

    def __init__(self) -> None:
        super().__init__("the rotor is levitated already; land it first")


class RebootedError(TargetError):
    """The target has been started anew: its settings are gone, and it counts steps anew."""

    def __init__(self) -> None:
        super().__init__("the target has rebooted: settings and steps are gone; find out why, and begin again")


class NoRecordError(TargetError):
    """A target, or a link to it, keeps nothing of the second before a trip: there is nothing to wait for."""


@dataclass(frozen=True)
class TargetDescription:
    """What a target is.

    Attributes
    ----------
    machine : Machine
        The machine that it controls, with source `bridge`.
    limits : Limits
        Those of its configuration; a host can only lower them.
    firmware : str
        Name and version.
    waveform_steps : int
        Longest excitation that it has room for, in steps.
    boot : bytes
        Differs at every boot.
    """

    machine: Machine
    limits: Limits
    firmware: str
    waveform_steps: int
    boot: bytes


@dataclass(frozen=True)
class TargetSettings:
    """What a host sets before levitation.

    Attributes
    ----------
    controller : ControllerParameters or LinearControl
        The law that closes the loop on the target.
    limits : Limits
        None above that of the target's configuration.
    landing_reference : tuple of float
        Where the reference of each axis ends before the currents are switched off (m).
    without_host : str
        Empty: the law closes the loop. Otherwise the host does, by `HostLoopLink.send_current`, and this is what the
        target does where the limit of missed steps is reached without a current: `off` trips, `land` lands by the law.
    """

    controller: KnownController
    limits: Limits
    landing_reference: tuple[float, ...]
    without_host: WithoutHost = ""


class LinkListener(Protocol):
    """Receives what a target sends. Called in the thread of the link: short, and without calls of the link."""

    def on_samples(self, block: TelemetryBlock) -> None:
        """Samples, each step once and in order; a step that is missing was lost.

        Parameters
        ----------
        block : TelemetryBlock
            Consecutive samples.
        """

    def on_status(self, status: TargetStatus) -> None:
        """The state of the target, at least every 100 ms and at once after a trip.

        Parameters
        ----------
        status : TargetStatus
            State, trips and counts of the target.
        """

    def on_silence(self) -> None:
        """The target does not answer any more."""

    def on_return(self, description: TargetDescription, rebooted: bool) -> None:
        """The target answers again. After a reboot it has forgotten settings and uploads, and counts steps anew.

        Parameters
        ----------
        description : TargetDescription
            What the target says of itself now.
        rebooted : bool
            Whether it has been started anew since.
        """


@dataclass
class LinkCount:
    """What a link has counted.

    Attributes
    ----------
    samples : TelemetryCount
        Samples delivered, lost, doubled, late and reordered.
    refused : int
        Datagrams that are no frame of this target.
    resent : int
        Commands that were sent again.
    round_trip : float
        Time from the latest command to its reply (s).
    clock_drift : float
        Clock of the target against that of the host (ppm, positive: the target's is faster); NaN before it is known.
    """

    samples: TelemetryCount = field(default_factory=TelemetryCount)
    refused: int = 0
    resent: int = 0
    round_trip: float = float("nan")
    clock_drift: float = float("nan")


class TargetLink(ABC):
    """A connection to one target. All methods but `connect` and `close` need a connection.

    Methods may be called from any thread but that of the listener, and block until the target has answered.

    Raises
    ------
    TargetError
        By every method: if the target does not answer in time, or refuses. One line with what and why.
    """

    count: LinkCount
    """What the link has counted since it was connected."""

    error: str = ""
    """The latest error of the listener, which ended nothing; empty if there was none."""

    @abstractmethod
    def connect(self, listener: LinkListener) -> TargetDescription:
        """Find the target and start its telemetry.

        Parameters
        ----------
        listener : LinkListener
            Receives samples and states.

        Returns
        -------
        TargetDescription
            What the target says of itself and its machine.
        """

    @abstractmethod
    def close(self) -> None:
        """Leave the target as it is, and end."""

    @abstractmethod
    def configure(self, settings: TargetSettings) -> None:
        """Send controller, limits and references.

        A rotor that is levitated when the host connects must not move: then this changes nothing until it has landed.

        Parameters
        ----------
        settings : TargetSettings
            Controller, limits and references of the machine.
        """

    @property
    def settings_wait(self) -> bool:
        """Whether settings wait until the rotor has landed; the next `configure` or `levitate` then sends them."""
        return False

    @abstractmethod
    def levitate(self, seconds: float) -> None:
        """Close the loop; the reference goes from where the rotor lies to the nominal one within this time.

        Parameters
        ----------
        seconds : float
            Duration of the lift (s).
        """

    @abstractmethod
    def land(self, seconds: float) -> None:
        """Stop the excitation; the reference goes to the landing one within this time, then currents are off.

        Parameters
        ----------
        seconds : float
            Duration of the landing (s).
        """

    @abstractmethod
    def upload(
        self, samples: NDArray[np.float64], cancelled: Callable[[], bool] = lambda: False
    ) -> Callable[[int], None]:
        """Bring an excitation (m), shape (steps, axes), to the target, bit for bit; nothing plays meanwhile.

        Parameters
        ----------
        samples : ndarray, shape (steps, axes)
            Excitation (m).
        cancelled : callable, optional
            Returns whether to give the upload up; never by default.

        Returns
        -------
        callable
            Arms it: plays it exactly from a step of the target onwards. Raises `TooLate` if that step has passed.
        """

    @abstractmethod
    def disarm(self) -> None:
        """Stop the excitation: it fades."""

    @abstractmethod
    def reset_faults(self) -> None:
        """Forget latched trips."""

    def trip_record(self) -> list[TelemetryBlock]:
        """What the target itself keeps of the second before its first trip: an optional capability.

        Returns
        -------
        list of TelemetryBlock
            Consecutive blocks with status words, in the order of their steps.

        Raises
        ------
        NoRecordError
            If it keeps nothing, or this link cannot ask for it.
        TargetError
            If it cannot be reached.
        """
        raise NoRecordError("this link does not read what a target keeps")

    def forget_trip_record(self) -> None:
        """Let the target keep the second before its next trip, while it stays levitated.

        Raises
        ------
        NoRecordError, TargetError
            As `trip_record`.
        """
        raise NoRecordError("this link does not read what a target keeps")

    @abstractmethod
    def status(self) -> TargetStatus:
        """The state of the target now.

        Returns
        -------
        TargetStatus
            State, trips and counts of the target.
        """


class HostLoopLink(TargetLink):
    """A link to a target that can leave its loop to the host, sample by sample: an optional capability.

    While `TargetSettings.without_host` is not empty, `on_samples` brings every sample at once, one step at a time, with
    position in float64. A sample that does not come in time is a gap; it is not waited for.
    """

    @abstractmethod
    def send_current(self, step: int, current: Sequence[float]) -> None:
        """Send the control current references (A) of all axes for a step that was measured.

        Called from any thread. It waits for no answer and raises nothing: a current that is lost is one that the target
        misses, and it holds the one before.

        Parameters
        ----------
        step : int
            Step of the target that was measured.
        current : sequence of float
            Control current references of all axes (A).
        """

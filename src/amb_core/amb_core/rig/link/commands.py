"""Commands of the host to a target, and the writer that numbers and authenticates them."""

from __future__ import annotations

import struct
import threading
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from amb_core.loop.known_controller import KnownController, LinearControl
from amb_core.loop.pd_parameters import ControllerParameters, pack_gains
from amb_core.rig.link.frames import Session, seal
from amb_core.rig.link.layout import FrameType, Law, Limits, ParameterKind
from amb_core.rig.link.link import TargetSettings


@dataclass(frozen=True)
class Command:
    """A command before it is numbered and authenticated; `step` only where it is armed at one.

    Attributes
    ----------
    type : FrameType
        Kind of the command.
    body : bytes, optional
        Its content.
    step : int, optional
        Step at which it is armed; 0 for a command that is not.
    """

    type: FrameType
    body: bytes = b""
    step: int = 0


class CommandWriter:
    """Numbers and authenticates the commands of one session.

    Parameters
    ----------
    session : Session
        Target, boot and key.
    counter : int, optional
        The last one that the target has accepted, from its description.
    """

    def __init__(self, session: Session, counter: int = 0) -> None:
        self.session = session
        self.counter = counter
        self._writing = threading.Lock()

    def write(self, command: Command) -> bytes:
        """Frame of a command, with the next counter. If its reply is lost, send the same frame again.

        Parameters
        ----------
        command : Command
            What to send.

        Returns
        -------
        bytes
            The frame, authenticated.
        """
        with self._writing:
            self.counter += 1
            counter = self.counter
        return seal(self.session, command.type, counter, command.body, counter & 0xFFFFFFFF, command.step)

    def catch_up(self, counter: int) -> None:
        """Go on after a counter that the target has accepted, from this host or another.

        Parameters
        ----------
        counter : int
            Counter of that command.
        """
        with self._writing:
            self.counter = max(self.counter, counter)


def heartbeat() -> Command:
    """Show that the host is there."""
    return Command(FrameType.HEARTBEAT)


def stream(rows: int, options: int = 0) -> Command:
    """Telemetry of `rows` samples a frame to the sender of this command from now on; 0 ends it.

    Parameters
    ----------
    rows : int
        Samples in a frame.
    options : TelemetryOption
        Their format, and what else telemetry holds.
    """
    return Command(FrameType.STREAM, struct.pack("<BBHI", options, 0, rows, 0))


def levitate(seconds: float = 0.0) -> Command:
    """Close the loop; the reference moves from where the rotor lies to the nominal one within this time (s)."""
    return Command(FrameType.LEVITATE, struct.pack("<d", seconds))


def delevitate(seconds: float = 0.0) -> Command:
    """Stop the excitation, move the reference to the landing one within this time (s), switch off."""
    return Command(FrameType.DELEVITATE, struct.pack("<d", seconds))


def fault_reset() -> Command:
    """Forget latched trips."""
    return Command(FrameType.FAULT_RESET)


def clock(host_time: int) -> Command:
    """Ask for the time of the target; the reply repeats the host's (ns)."""
    return Command(FrameType.CLOCK, struct.pack("<Q", host_time))


def arm(upload: int, step: int) -> Command:
    """Play an uploaded excitation from a step onwards."""
    return Command(FrameType.ARM, struct.pack("<II", upload, 0), step)


def disarm() -> Command:
    """Stop the excitation: it fades."""
    return Command(FrameType.DISARM)


def gains(parameters: ControllerParameters, axes: int) -> Command:
    """Gains of the PD controller; its current limit is one of the target's limits.

    Raises
    ------
    ParameterError
        If gains are given for another number of axes.
    """
    return _parameters(ParameterKind.GAINS, pack_gains(parameters, axes)[:, :5])


def nominal_reference(position: Sequence[float]) -> Command:
    """Reference of each axis without an excitation (m)."""
    return _parameters(ParameterKind.NOMINAL_REFERENCE, position)


def landing_reference(position: Sequence[float]) -> Command:
    """Where the reference of each axis ends before the currents are switched off (m)."""
    return _parameters(ParameterKind.LANDING_REFERENCE, position)


def limits(values: Limits) -> Command:
    """Limits; none may be above that of the target's configuration."""
    return Command(FrameType.PARAMETERS, struct.pack("<Q", ParameterKind.LIMITS) + values.to_bytes())


def settings(wanted: TargetSettings, law: KnownController, axes: int) -> dict[str, Command]:
    """Limits, gains of a PD law, and references, by kind and in the order in which they are sent."""
    gains_of_pd: dict[str, Command] = {}
    if isinstance(law, LinearControl):
        nominal = law.parameters.nominal_reference
    else:
        nominal, gains_of_pd = law.nominal_reference, {"gains": gains(law, axes)}
    none = (0.0,) * axes
    return {
        "limits": limits(wanted.limits),
        **gains_of_pd,
        "nominal": nominal_reference(nominal or none),
        "landing": landing_reference(wanted.landing_reference or none),
    }


def controller(law: Law) -> Command:
    """Choose who sets the control currents; only while the rotor is not levitated."""
    return Command(FrameType.CONTROLLER, struct.pack("<Q", law))


def record(first_row: int) -> Command:
    """Ask for what the target keeps of the second before a trip, from a row of it onwards."""
    return Command(FrameType.RECORD, struct.pack("<II", first_row, 0))


def forget_record() -> Command:
    """Let the target forget that second, so that it keeps the one before the next trip."""
    return Command(FrameType.RECORD, struct.pack("<II", 0, 1))


def current(session: Session, step: int, values: Sequence[float]) -> bytes:
    """Frame with the control current references of all axes (A) for a step that was measured.

    It has a tag like that of a command, but no counter: its step must be later than that of the last one taken. So it
    needs no reply, and does not come between another command and its repetition.
    """
    body = struct.pack(f"<{len(values)}d", *values)
    return seal(session, FrameType.CURRENT, 0, body, step=step)


def _parameters(kind: ParameterKind, values: ArrayLike) -> Command:
    block = np.asarray(values, dtype="<f8").tobytes()
    return Command(FrameType.PARAMETERS, struct.pack("<Q", kind) + block)

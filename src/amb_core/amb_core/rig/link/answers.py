"""What a target sends, decoded: replies, status and telemetry, and its description by `description`."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.rig.link.description import Description, description_of
from amb_core.rig.link.frames import Frame, Refusal, Session, decode_frame, opened
from amb_core.rig.link.layout import (
    CHECKSUM,
    Code,
    ExcitationPhase,
    FrameType,
    Law,
    TargetState,
    TelemetryOption,
    TripReason,
)

_STATUS = struct.Struct("<BBBBIIIIIQ")
_TRIP = struct.Struct("<BB6xQd")
_REPLY = struct.Struct("<BBHI")
_TELEMETRY = struct.Struct("<BBBxHH")
_RECORD = struct.Struct("<QIHH")
_LAST_STEP = 1 << 62
_WIDE, _WITH_COILS, _WITH_STATUS = (int(option) for option in TelemetryOption)  # flags are slow in a stream
_NUMBERS: dict[int, np.dtype[Any]] = {4: np.dtype("<f4"), 8: np.dtype("<f8")}


@dataclass(frozen=True)
class Trip:
    """A latched trip.

    Attributes
    ----------
    reason : TripReason
        What tripped.
    step : int
        Step of the target.
    axis : int
        Index of the axis, or of the coil.
    value : float
        The value that caused it, in the unit of its limit.
    """

    reason: TripReason
    step: int
    axis: int
    value: float


@dataclass(frozen=True)
class TargetStatus:
    """State of a target at a step, and what it has counted since its boot.

    Attributes
    ----------
    step : int
        The step that comes next.
    state : TargetState
        Levitated or not.
    excitation : ExcitationPhase
        What the excitation does.
    state_space, alarm, streaming, upload_ready, controller_ready : bool
        Whether the state-space controller is chosen, displacement is beyond the alarm, telemetry is sent, an upload is
        complete, and a state-space controller is there.
    by_host : bool
        Whether the host is to set the currents.
    locked : bool
        Whether faults cannot be reset yet, after a trip by displacement.
    missed, bad, forged, replayed, unsent : int
        Control steps missed; frames damaged or of another boot, with a wrong tag, with an old counter; frames that
        could not be sent.
    counter : int
        Last counter of a command that it accepted.
    trips : tuple of Trip
        Latched, in the order of their first occurrence.
    """

    step: int
    state: TargetState
    excitation: ExcitationPhase
    state_space: bool
    alarm: bool
    streaming: bool
    upload_ready: bool
    controller_ready: bool
    missed: int
    bad: int
    forged: int
    replayed: int
    unsent: int
    counter: int
    trips: tuple[Trip, ...]
    by_host: bool = False
    locked: bool = False

    @property
    def currents_on(self) -> bool:
        """Whether the rotor is levitated, or on its way up or down."""
        return self.state not in (TargetState.OFF, TargetState.TRIPPED)


@dataclass(frozen=True)
class Reply:
    """The reply to a command.

    Attributes
    ----------
    counter : int
        That of the command.
    command : FrameType
        Its type.
    code : Code
        What became of it.
    status : TargetStatus
        After it.
    clock : tuple of int or None
        Times of the host and of the target (ns), of a CLOCK command. None for other commands.
    missing : tuple of int or None
        Chunks that have not arrived, of a BITMAP command. None for other commands.
    record : RecordPart or None
        Of a RECORD command that asked for rows. None for other commands.
    """

    counter: int
    command: FrameType
    code: Code
    status: TargetStatus
    clock: tuple[int, int] | None = None
    missing: tuple[int, ...] | None = None
    record: RecordPart | None = None


@dataclass(frozen=True)
class TelemetryBlock:
    """Consecutive samples of the loop.

    Attributes
    ----------
    first_step, sequence : int
        Step of the first sample; number of the frame since boot.
    reference, position, current : ndarray, shape (steps, axes)
        Reference and measured position (m), control current reference (A).
    coil_current : ndarray, shape (steps, coils), or None
        Measured coil currents (A). None if the target sends none.
    status : ndarray of uint32, shape (steps,), or None
        Bits 0 to 2: state; 3: alarm; 4 and 5: excitation; 8 to 15: number of latched trips. None if the target sends
        none.
    """

    first_step: int
    sequence: int
    reference: NDArray[np.float64]
    position: NDArray[np.float64]
    current: NDArray[np.float64]
    coil_current: NDArray[np.float64] | None = None
    status: NDArray[np.uint32] | None = None

    @property
    def steps(self) -> int:
        """Number of samples."""
        return len(self.position)

    def part(self, first: int, stop: int) -> TelemetryBlock:
        """Its samples from one row to before another.

        Parameters
        ----------
        first : int
            First row that is kept.
        stop : int
            Row after the last one that is kept.

        Returns
        -------
        TelemetryBlock
            A block of these rows, with the step of the first one.
        """
        if (first, stop) == (0, self.steps):
            return self
        rows = slice(first, stop)
        return TelemetryBlock(
            self.first_step + first,
            self.sequence,
            self.reference[rows],
            self.position[rows],
            self.current[rows],
            None if self.coil_current is None else self.coil_current[rows],
            None if self.status is None else self.status[rows],
        )


@dataclass(frozen=True)
class RecordPart:
    """Rows of the second before a trip that a target keeps.

    Attributes
    ----------
    rows : int
        Rows of all of it.
    samples : TelemetryBlock
        Those in this reply, with status words.
    """

    rows: int
    samples: TelemetryBlock


Answer = Description | Reply | TargetStatus | TelemetryBlock


def decode(datagram: bytes, session: Session | None = None) -> Answer | Refusal:
    """Decode a datagram of a target; of any other one, the reason why it is refused.

    Parameters
    ----------
    datagram : bytes
        As received.
    session : Session, optional
        From its description. Without one only descriptions are taken; with one, only frames of this boot. None before
        the description.

    Returns
    -------
    Answer or Refusal
        What the datagram says, or why it is refused.
    """
    frame = decode_frame(datagram)
    if isinstance(frame, Refusal):
        return frame
    if frame.type is FrameType.DESCRIPTION:
        return description_of(frame, datagram[:-CHECKSUM])
    if frame.type < FrameType.DESCRIPTION:
        return Refusal(f"{frame.type.name} is a command; expected: a frame of a target")
    if session is None:
        return Refusal(f"{frame.type.name} before the description of the target")
    if frame.session != session.number:
        return Refusal(f"{frame.type.name} of session {frame.session:#010x}; this is {session.number:#010x}")
    if frame.step > _LAST_STEP:
        return Refusal(f"{frame.type.name} of step {frame.step}; allowed: up to {_LAST_STEP}")
    if frame.type is FrameType.TELEMETRY:
        return _telemetry(frame, session)
    if frame.type is FrameType.STATUS:
        return _status(frame.payload, frame.step)
    content = opened(session, datagram, frame)
    return content if isinstance(content, Refusal) else _reply(*content, frame.step, session)


def _status(block: bytes, step: int) -> TargetStatus | Refusal:
    """What follows the known fields is of later firmware, and left alone."""
    if len(block) < _STATUS.size:
        return Refusal(f"status of {len(block)} bytes; needed: {_STATUS.size}")
    state, law, count, flags, *counts, counter = _STATUS.unpack_from(block)
    if len(block) < _STATUS.size + count * _TRIP.size:
        return Refusal(f"status of {len(block)} bytes is too short for {count} trips")
    try:
        trips = tuple(
            Trip(TripReason(reason), at, axis, value)
            for reason, axis, at, value in (
                _TRIP.unpack_from(block, _STATUS.size + row * _TRIP.size) for row in range(count)
            )
        )
        known, phase = TargetState(state), ExcitationPhase(flags >> 1 & 3)
    except ValueError as problem:
        return Refusal(f"status: {problem}")
    alarm, streaming, ready, controller = (bool(flags & bit) for bit in (1, 16, 32, 64))
    missed, bad, forged, replayed, unsent = counts
    return TargetStatus(
        step, known, phase, law == Law.STATE_SPACE, alarm, streaming, ready, controller,
        missed, bad, forged, replayed, unsent, counter, trips, law >= Law.HOST, bool(flags & 8),
    )  # fmt: skip


def _reply(counter: int, body: bytes, step: int, session: Session) -> Reply | Refusal:
    if len(body) < _REPLY.size:
        return Refusal(f"reply of {len(body)} bytes; needed: {_REPLY.size}")
    kind, code, status_length, extra_length = _REPLY.unpack_from(body)
    if _REPLY.size + status_length + extra_length != len(body):
        return Refusal(f"reply of {len(body)} bytes; its parts have {_REPLY.size + status_length + extra_length}")
    status = _status(body[_REPLY.size : _REPLY.size + status_length], step)
    if isinstance(status, Refusal):
        return status
    try:
        command, known = FrameType(kind), Code(code)
    except ValueError as problem:
        return Refusal(f"reply: {problem}")
    extra = body[_REPLY.size + status_length :]
    times = struct.unpack("<QQ", extra) if command is FrameType.CLOCK and len(extra) == 16 else None
    missing = _missing(extra) if command is FrameType.BITMAP and extra else None
    record = _record(extra, session.axes) if command is FrameType.RECORD and extra else None
    if isinstance(missing, Refusal):
        return missing
    return record if isinstance(record, Refusal) else Reply(counter, command, known, status, times, missing, record)


def _missing(extra: bytes) -> tuple[int, ...] | Refusal:
    if len(extra) < 8:
        return Refusal(f"bitmap of {len(extra)} bytes; needed: 8")
    chunks = int.from_bytes(extra[4:8], "little")
    if len(extra) != 8 + (chunks + 7) // 8:
        return Refusal(f"bitmap of {len(extra)} bytes for {chunks} chunks")
    there = np.unpackbits(np.frombuffer(extra, np.uint8, offset=8), count=chunks, bitorder="little")
    return tuple(np.flatnonzero(there == 0).tolist())


def _record(extra: bytes, axes: int) -> RecordPart | Refusal:
    if len(extra) < _RECORD.size:
        return Refusal(f"record of {len(extra)} bytes; needed: {_RECORD.size}")
    first_step, rows, here, row = _RECORD.unpack_from(extra)
    if row != 4 * (3 * axes + 1) or len(extra) != _RECORD.size + here * row or here > rows:
        return Refusal(f"record of {len(extra)} bytes for {here} of {rows} rows of {row} bytes and {axes} axes")
    if first_step > _LAST_STEP:
        return Refusal(f"record of step {first_step}; allowed: up to {_LAST_STEP}")
    words = np.frombuffer(extra, "<u4", -1, _RECORD.size).reshape(here, row // 4)
    return RecordPart(rows, _block(first_step, 0, _wide(words.view("<f4")), axes, 0, words[:, 3 * axes]))


def _wide(values: NDArray[Any]) -> NDArray[np.float64]:
    with np.errstate(invalid="ignore"):  # NaN of a failed sensor, in any of its forms
        return values.astype(np.float64)


def _block(
    first_step: int, sequence: int, rows: NDArray[np.float64], axes: int, coils: int, status: NDArray[Any] | None
) -> TelemetryBlock:
    return TelemetryBlock(
        first_step,
        sequence,
        rows[:, :axes],
        rows[:, axes : 2 * axes],
        rows[:, 2 * axes : 3 * axes],
        rows[:, 3 * axes : 3 * axes + coils] if coils else None,
        None if status is None else status.astype(np.uint32),
    )


def _telemetry(frame: Frame, session: Session) -> TelemetryBlock | Refusal:
    if len(frame.payload) < _TELEMETRY.size:
        return Refusal(f"telemetry of {len(frame.payload)} bytes; needed: {_TELEMETRY.size}")
    options, axes, coils, rows, row = _TELEMETRY.unpack_from(frame.payload)
    with_status = bool(options & _WITH_STATUS)
    width = 8 if options & _WIDE else 4
    if axes != session.axes or coils != (session.coils if options & _WITH_COILS else 0) or options > 7:
        return Refusal(
            f"telemetry of {axes} axes and {coils} coils with options {options}; the target has {session.axes} axes "
            f"and {session.coils} coils"
        )
    if row != width * (3 * axes + coils + with_status) or not rows:
        return Refusal(f"telemetry with {rows} rows of {row} bytes for {axes} axes and {coils} coils")
    if len(frame.payload) != _TELEMETRY.size + rows * row:
        return Refusal(f"telemetry of {len(frame.payload)} bytes for {rows} rows of {row}")
    values = np.frombuffer(frame.payload, _NUMBERS[width], -1, _TELEMETRY.size).reshape(rows, row // width)
    status = None
    if with_status:
        words = np.frombuffer(frame.payload, "<u4", -1, _TELEMETRY.size).reshape(rows, row // 4)
        status = words[:, (3 * axes + coils) * width // 4]
    return _block(frame.step, frame.sequence, _wide(values), axes, coils, status)

"""Numbers of AMB-UDP: types, codes, states and sizes of its frames.

They are those of docs/reference/target-protocol.md and amb_target.h.
"""

from __future__ import annotations

import struct
from dataclasses import astuple, dataclass, fields
from enum import IntEnum, IntFlag
from typing import Self

from amb_core.ground.errors import TargetError

VERSION = 2
MAGIC = b"AMBU"
HEADER = struct.Struct("<4sBBHIIQ")
"""Magic, version, type, length of the payload, session, sequence, step."""
LARGEST_FRAME = 1472
"""Bytes of the largest frame: one Ethernet frame of 1500 bytes without the headers of IP and UDP."""
CHECKSUM, COUNTER, TAG, NONCE, CHALLENGE = 4, 8, 16, 16, 16
CHUNK = 1408
"""Bytes of every chunk of an upload but the last."""
HELLO_LENGTH = 1152
MOST_AXES = 16
LONGEST_KEY = 64


class FrameType(IntEnum):
    """Types of frames; those from 0x80 onwards come from the target."""

    HELLO = 0x01
    HEARTBEAT = 0x10
    STREAM = 0x11
    LEVITATE = 0x12
    DELEVITATE = 0x13
    FAULT_RESET = 0x14
    CLOCK = 0x15
    BEGIN = 0x16
    DATA = 0x17
    BITMAP = 0x18
    COMMIT = 0x19
    ARM = 0x1A
    DISARM = 0x1B
    PARAMETERS = 0x1C
    CONTROLLER = 0x1D
    CURRENT = 0x1E
    RECORD = 0x1F
    DESCRIPTION = 0x81
    REPLY = 0x82
    TELEMETRY = 0x90
    STATUS = 0x91


class Code(IntEnum):
    """Codes of replies."""

    DONE = 0
    WRONG_STATE = 1
    BAD_LENGTH = 2
    BAD_VALUE = 3
    BEYOND_LIMIT = 4
    UNKNOWN = 5
    NO_UPLOAD = 6
    INCOMPLETE = 7
    CHECKSUM = 8
    TOO_LATE = 9
    LATCHED = 10
    TOO_LARGE = 11
    BUSY = 12
    LOCKED = 13


class TargetState(IntEnum):
    """States of the target."""

    OFF = 0
    LEVITATING = 1
    LEVITATED = 2
    LANDING = 3
    TRIPPED = 4


class TripReason(IntEnum):
    """Reasons of trips. HOST_SILENT and EXCITATION leave the loop closed; the others switch off."""

    DISPLACEMENT = 1
    SENSOR_RANGE = 2
    SENSOR_STUCK = 3
    OVER_CURRENT = 4
    TEMPERATURE = 5
    AMPLIFIER = 6
    WATCHDOG = 7
    LAW = 8
    HOST_SILENT = 9
    EXCITATION = 10
    SATURATED = 11


class ExcitationPhase(IntEnum):
    """What the excitation does."""

    NONE = 0
    ARMED = 1
    PLAYING = 2
    FADING = 3


class ParameterKind(IntEnum):
    """What a PARAMETERS command sets."""

    GAINS = 1
    NOMINAL_REFERENCE = 2
    LANDING_REFERENCE = 3
    LIMITS = 4


class UploadKind(IntEnum):
    """What an upload is."""

    EXCITATION = 1
    STATE_SPACE = 2


class Law(IntEnum):
    """Who sets the control currents. Without those of the host, the watchdog switches off, or the PD law lands."""

    PD = 0
    STATE_SPACE = 1
    HOST = 2
    HOST_OR_LAND = 3


class TelemetryOption(IntFlag):
    """What telemetry holds besides reference, position and control current, and how."""

    FLOAT64 = 1
    COILS = 2
    STATUS = 4


@dataclass(frozen=True)
class Limits:
    """Limits of the target, in their order in frames; each is positive.

    Attributes
    ----------
    control_current : float
        Magnitude of the control current references (A).
    coil_current, coil_time : float
        Measured coil current (A), and how long it may be above (s): trip.
    alarm_share, trip_share : float
        Radial displacement over clearance (-): alarm, and trip.
    excitation_amplitude, excitation_slew : float
        Excitation of an axis (m), and its change (m/s), from and to zero too.
    sensor_range, stuck_time : float
        Magnitude of a measured position (m), and how long it may stay the same bit for bit (s): trip.
    temperature : float
        Temperature input (deg C): trip.
    host_time, land_time : float
        Time without a command until an armed or playing excitation stops, and until the machine lands (s).
    fade_time : float
        Time in which an excitation that is stopped goes to zero (s); longer where its slew asks for it.
    settle_time : float
        Time from levitation until displacement can trip; duration of a landing without a host (s).
    missed_steps : float
        Control steps missed lately (steps): trip.
    reference_slew : float
        Change of the reference while it moves, the excitation apart (m/s).
    contact_share : float
        Radial displacement over clearance while levitating, landing or settling (-): trip.
    lift_time : float
        Time for which the rotor may be farther from the reference than the trip share allows (s): trip.
    saturation_time : float
        Time for which a control current may be at its limit (s): trip.
    missed_share : float
        Share of missed control steps, from which on they add up to `missed_steps` (-).
    lock_time : float
        Time after a trip by displacement in which faults are not reset (s); infinite: until a restart.

    Raises
    ------
    TargetError
        If a limit is not positive.
    """

    control_current: float = 3.0
    coil_current: float = 12.0
    coil_time: float = 1e-3
    alarm_share: float = 0.4
    trip_share: float = 0.5
    excitation_amplitude: float = 100e-6
    excitation_slew: float = 10.0
    sensor_range: float = 1e-3
    stuck_time: float = 0.02
    temperature: float = 120.0
    host_time: float = 0.02
    land_time: float = float("inf")
    fade_time: float = 0.01
    settle_time: float = 0.5
    missed_steps: float = 20.0
    reference_slew: float = 0.01
    contact_share: float = 1.2
    lift_time: float = 0.2
    saturation_time: float = 0.05
    missed_share: float = 0.05
    lock_time: float = 0.2

    def __post_init__(self) -> None:
        for name, value in zip((field.name for field in fields(self)), astuple(self), strict=True):
            if not value > 0.0:  # not NaN
                raise TargetError(f"limit {name} is {value:g}; allowed: more than 0")

    def __str__(self) -> str:
        return ", ".join(f"{field.name} {getattr(self, field.name):g}" for field in fields(self))

    def to_bytes(self) -> bytes:
        """As in frames.

        Returns
        -------
        bytes
            8 bytes for each limit.
        """
        return struct.pack(f"<{len(fields(self))}d", *astuple(self))

    @classmethod
    def from_bytes(cls, block: bytes) -> Self:
        """From a frame.

        Parameters
        ----------
        block : bytes
            Limits as in frames, 8 bytes each.

        Returns
        -------
        Limits
            The limits.

        Raises
        ------
        TargetError
            If a limit is not positive.
        """
        return cls(*struct.unpack(f"<{len(fields(cls))}d", block))

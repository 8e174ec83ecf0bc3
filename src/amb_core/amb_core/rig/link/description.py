"""What a target says about itself, in answer to a HELLO: the machine, its limits, and where its commands stand."""

from __future__ import annotations

import hmac
import struct
from dataclasses import dataclass, field

from amb_core.ground.errors import AmbError, MachineError
from amb_core.loop.machine import Machine, MachineAxis, MachineBearing
from amb_core.rig.link.frames import Frame, Refusal, Session, tag
from amb_core.rig.link.layout import MOST_AXES, TAG, Limits

_FIXED = struct.Struct("<16s16sQ32s32sdIIHHIBBBBI")
_LIMITS = len(Limits().to_bytes())
_AXIS = struct.Struct("<16s16s8d")
_LAST_COUNTER = 1 << 62
PER_PAGE = 8


@dataclass(frozen=True)
class Description:
    """A page of the description of a target: everything about it, and up to eight of its axes from `first_axis` on.

    Attributes
    ----------
    challenge : bytes
        That of the HELLO which it answers.
    nonce : bytes
        Random number of this boot.
    counter : int
        Last counter of a command that it accepted.
    machine, firmware : str
        Names.
    firmware_version : tuple of int
        Major, minor, patch.
    sample_rate : float
        Controller sample rate (Hz).
    waveform_bytes, most_chunks, most_states, most_matrix_numbers : int
        Room for uploads.
    axes, coils : int
        Axes, and measured coil currents.
    with_key : bool
        Whether commands need a key; without one it takes them from its own host only.
    limits : Limits
        Those of its configuration, which a host can only lower.
    first_axis : int
        First axis of this page.
    page : tuple of (MachineAxis, float)
        Its axes, with the clearance of the bearing of each (m).
    sealed : bytes
        The frame up to the end of its tag.
    """

    challenge: bytes
    nonce: bytes
    counter: int
    machine: str
    firmware: str
    firmware_version: tuple[int, int, int]
    sample_rate: float
    waveform_bytes: int
    most_chunks: int
    most_states: int
    most_matrix_numbers: int
    axes: int
    coils: int
    with_key: bool
    limits: Limits
    first_axis: int
    page: tuple[tuple[MachineAxis, float], ...]
    sealed: bytes = field(repr=False, compare=False)

    def genuine(self, key: bytes) -> bool:
        """Whether a target with this key has sent it.

        Parameters
        ----------
        key : bytes
            Secret shared with the target.

        Returns
        -------
        bool
            True if the authentication tag is that of the key.
        """
        return hmac.compare_digest(tag(self.session(key), self.sealed[:-TAG]), self.sealed[-TAG:])

    def session(self, key: bytes = b"") -> Session:
        """Session with this target.

        Parameters
        ----------
        key : bytes, optional
            Secret shared with the target; empty without one.

        Returns
        -------
        Session
            What commands and answers of this boot need.
        """
        return Session(self.nonce, self.axes, self.coils, key)


def machine_of(pages: list[Description]) -> Machine:
    """The machine that a target describes on all its pages, with source `bridge`.

    Parameters
    ----------
    pages : list of Description
        Descriptions of one target, in any order.

    Returns
    -------
    Machine
        Axes, bearings and sample rate.

    Raises
    ------
    MachineError
        If they contradict each other, an axis is missing, or the machine is impossible.
    """
    ordered = sorted(pages, key=lambda page: page.first_axis)
    axes = [axis for page in ordered for axis in page.page]
    if not ordered or len({page.nonce for page in ordered}) > 1 or len(axes) != ordered[0].axes:
        raise MachineError(f"the pages describe {len(axes)} axes; expected: all axes of one target, once, of one boot")
    clearances: dict[str, float] = {}
    for axis, clearance in axes:
        if clearances.setdefault(axis.bearing, clearance) != clearance:
            both = f"{clearances[axis.bearing]:g} and {clearance:g} m"
            raise MachineError(f"bearing {axis.bearing!r} has clearances {both}; expected: one")
    bearings = tuple(MachineBearing(name, clearance) for name, clearance in clearances.items())
    page = ordered[0]
    return Machine(page.machine, "bridge", page.sample_rate, tuple(axis for axis, _ in axes), bearings)


def description_of(frame: Frame, sealed: bytes) -> Description | Refusal:
    """Page of a description, from a frame and its bytes up to the end of its tag."""
    if len(frame.payload) < _FIXED.size + _LIMITS:
        return Refusal(f"description of {len(frame.payload)} bytes; needed: {_FIXED.size + _LIMITS}")
    (
        challenge, nonce, counter, machine, firmware, rate, version, room, numbers, states, chunks,
        axes, first, here, coils, keyed,
    ) = _FIXED.unpack_from(frame.payload)  # fmt: skip
    if len(frame.payload) < _FIXED.size + _LIMITS + here * _AXIS.size + TAG:
        return Refusal(f"description of {len(frame.payload)} bytes is too short for {here} axes")
    if not 1 <= axes <= MOST_AXES or coils > 2 * MOST_AXES or first >= axes or here != min(PER_PAGE, axes - first):
        return Refusal(f"description of {here} axes from {first} onwards, of {axes}, with {coils} coils")
    if int.from_bytes(nonce[:4], "little") != frame.session or not frame.session:
        return Refusal(f"description of session {frame.session:#010x} with another nonce")
    if counter >= _LAST_COUNTER:
        return Refusal(f"description with the counter {counter}; allowed: below {_LAST_COUNTER}")
    if not 0.0 < rate < float("inf"):
        return Refusal(f"description with a sample rate of {rate:g} Hz; allowed: more than 0")
    try:
        limits = Limits.from_bytes(frame.payload[_FIXED.size : _FIXED.size + _LIMITS])
        names = _text(machine), _text(firmware)
        page = tuple(_axis(frame.payload, _FIXED.size + _LIMITS + row * _AXIS.size) for row in range(here))
    except (AmbError, UnicodeDecodeError) as problem:
        return Refusal(f"description: {problem}")
    numbered = version >> 16, version >> 8 & 0xFF, version & 0xFF
    sizes = room, chunks, states, numbers, axes, coils
    return Description(
        challenge, nonce, counter, *names, numbered, rate, *sizes, bool(keyed), limits, first, page, sealed
    )


def _axis(payload: bytes, offset: int) -> tuple[MachineAxis, float]:
    name, bearing, sensor, actuator, x, y, z, bias, followed, clearance = _AXIS.unpack_from(payload, offset)
    return MachineAxis(_text(name), _text(bearing), sensor, actuator, (x, y, z), bias, followed), clearance


def _text(name: bytes) -> str:
    return name.split(b"\0", 1)[0].decode()

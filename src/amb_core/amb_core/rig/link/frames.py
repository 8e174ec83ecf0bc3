"""Frames of AMB-UDP: header, checksum and authentication. What arrives is decoded or refused, and never raises.

Source of the authentication: RFC 2104 (HMAC) and FIPS 180-4 (SHA-256); the tag is truncated to 128 bits as RFC 2104,
section 5, allows.
"""

from __future__ import annotations

import hmac
import struct
import zlib
from dataclasses import dataclass, field

from amb_core.ground.errors import TargetError
from amb_core.rig.link.layout import (
    CHALLENGE,
    CHECKSUM,
    COUNTER,
    HEADER,
    HELLO_LENGTH,
    LARGEST_FRAME,
    LONGEST_KEY,
    MAGIC,
    TAG,
    VERSION,
    FrameType,
)

_TYPES = {int(kind): kind for kind in FrameType}


@dataclass(frozen=True)
class Refusal:
    """A datagram that was not accepted.

    Attributes
    ----------
    reason : str
        Why, with values; for logs.
    """

    reason: str


@dataclass(frozen=True)
class Frame:
    """A frame with right checksum; its payload has not been looked at."""

    type: FrameType
    session: int
    sequence: int
    step: int
    payload: bytes


@dataclass(frozen=True)
class Session:
    """What a host knows of a target since one boot.

    Attributes
    ----------
    nonce : bytes
        16 random bytes that the target draws at each boot; the first four number the session.
    axes, coils : int
        Axes of the machine, and coil currents that the target measures.
    key : bytes
        Shared secret; empty: the target takes commands from its own host only.
    """

    nonce: bytes
    axes: int
    coils: int
    key: bytes = field(default=b"", repr=False)

    def __post_init__(self) -> None:
        require_key(self.key)

    @property
    def number(self) -> int:
        """Session, as in the header of frames."""
        return int.from_bytes(self.nonce[:4], "little")


def require_key(key: bytes) -> None:
    """Raise TargetError unless a key has 16 to 64 bytes, or none."""
    if key and not 16 <= len(key) <= LONGEST_KEY:
        raise TargetError(f"the key has {len(key)} bytes; allowed: 16 to {LONGEST_KEY}, or none")


def encode(kind: FrameType, payload: bytes, session: int = 0, sequence: int = 0, step: int = 0) -> bytes:
    """Frame without authentication.

    Raises
    ------
    TargetError
        If it is longer than an Ethernet frame carries.
    """
    length = HEADER.size + len(payload) + CHECKSUM
    if length > LARGEST_FRAME:
        raise TargetError(f"a frame of {length} bytes; allowed: up to {LARGEST_FRAME}")
    frame = HEADER.pack(MAGIC, VERSION, kind, len(payload), session, sequence, step) + payload
    return frame + struct.pack("<I", zlib.crc32(frame))


def seal(session: Session, kind: FrameType, counter: int, body: bytes, sequence: int = 0, step: int = 0) -> bytes:
    """Frame with a counter before its body and a tag after it.

    Raises
    ------
    TargetError
        If it is longer than an Ethernet frame carries.
    """
    length = COUNTER + len(body) + TAG
    header = HEADER.pack(MAGIC, VERSION, kind, length & 0xFFFF, session.number, sequence, step)
    counted = struct.pack("<Q", counter) + body
    return encode(kind, counted + tag(session, header + counted), session.number, sequence, step)


def tag(session: Session, frame: bytes) -> bytes:
    """First 16 bytes of HMAC-SHA-256 of the nonce and a frame up to its tag."""
    return hmac.digest(session.key, session.nonce + frame, "sha256")[:TAG]


def hello(first_axis: int = 0, sequence: int = 0, challenge: bytes = bytes(CHALLENGE)) -> bytes:
    """Request of the description of a target, of eight axes from `first_axis` onwards; the answer repeats `challenge`.

    It is as long as any answer, so that a target cannot be used to flood a third host.

    Parameters
    ----------
    first_axis : int, optional
        First axis that the answer describes.
    sequence : int, optional
        Number of the frame.
    challenge : bytes, optional
        Random bytes that show that the answer is to this request.

    Returns
    -------
    bytes
        The frame.
    """
    payload = bytes([first_axis]) + bytes(7) + challenge
    return encode(FrameType.HELLO, payload.ljust(HELLO_LENGTH, b"\0"), sequence=sequence)


def decode_frame(datagram: bytes) -> Frame | Refusal:
    """Check length, magic, version, type and checksum of a datagram."""
    if len(datagram) < HEADER.size + CHECKSUM:
        return Refusal(f"{len(datagram)} bytes; allowed: {HEADER.size + CHECKSUM} to {LARGEST_FRAME}")
    magic, version, kind, length, session, sequence, step = HEADER.unpack_from(datagram)
    if magic != MAGIC:
        return Refusal(f"magic {magic!r}; expected: {MAGIC!r}")
    if version != VERSION:  # first, since it decides what everything else means
        return Refusal(f"version {version} of the protocol; known: {VERSION}")
    if len(datagram) > LARGEST_FRAME:
        return Refusal(f"{len(datagram)} bytes; allowed: {HEADER.size + CHECKSUM} to {LARGEST_FRAME}")
    if HEADER.size + length + CHECKSUM != len(datagram):
        return Refusal(f"its header gives it {HEADER.size + length + CHECKSUM} bytes, it has {len(datagram)}")
    if zlib.crc32(memoryview(datagram)[:-CHECKSUM]) != int.from_bytes(datagram[-CHECKSUM:], "little"):
        return Refusal("wrong checksum")
    if kind not in _TYPES:
        return Refusal(f"unknown type {kind:#04x}")
    return Frame(_TYPES[kind], session, sequence, step, bytes(datagram[HEADER.size : -CHECKSUM]))


def opened(session: Session, datagram: bytes, frame: Frame) -> tuple[int, bytes] | Refusal:
    """Counter and body of an authenticated frame."""
    if len(frame.payload) < COUNTER + TAG:
        return Refusal(f"{frame.type.name} of {len(frame.payload)} bytes; needed: {COUNTER + TAG} at least")
    end = len(datagram) - CHECKSUM - TAG
    if not hmac.compare_digest(tag(session, datagram[:end]), datagram[end:-CHECKSUM]):
        return Refusal(f"{frame.type.name} with a wrong tag")
    return int.from_bytes(frame.payload[:COUNTER], "little"), frame.payload[COUNTER:-TAG]

"""Frames of AMB-UDP over a stream of bytes: each in COBS (S. Cheshire and M. Baker 1999), ended by a zero byte.

The target's side is `target/ports/stream.c`. Whatever is lost or changed, the frame after the next zero byte is whole.
"""

from __future__ import annotations

from amb_core.rig.link.layout import LARGEST_FRAME

_GROUP = 254  # most bytes after a code
LONGEST = LARGEST_FRAME + LARGEST_FRAME // _GROUP + 1  # bytes of a frame in the stream, before its end


def to_stream(frame: bytes) -> bytes:
    """A frame as it goes into the stream.

    Parameters
    ----------
    frame : bytes
        Frame of AMB-UDP.

    Returns
    -------
    bytes
        The frame in COBS, and the zero byte that ends it.
    """
    out = bytearray()
    for run in frame.split(b"\0"):
        whole = len(run) // _GROUP * _GROUP
        for start in range(0, whole, _GROUP):
            out += b"\xff" + run[start : start + _GROUP]
        out.append(len(run) - whole + 1)
        out += run[whole:]
    return bytes(out) + b"\0"


def from_stream(packet: bytes) -> bytes | None:
    """The frame in the bytes between two zeros.

    Parameters
    ----------
    packet : bytes
        What lies between two zero bytes of the stream; it has none itself.

    Returns
    -------
    bytes or None
        The frame; None if bytes of it are missing, or it is longer than any frame.
    """
    frame, at = bytearray(), 0
    while at < len(packet):
        code = packet[at]
        if at + code > len(packet):
            return None
        frame += packet[at + 1 : at + code]
        at += code
        if code <= _GROUP and at < len(packet):
            frame.append(0)
    return bytes(frame) if len(frame) <= LARGEST_FRAME else None


class StreamReader:
    """Finds the frames in a stream that may begin anywhere, and lose or change bytes."""

    def __init__(self) -> None:
        self._packet = bytearray()
        self._broken = False

    def take(self, received: bytes) -> list[bytes]:
        """The frames that end in some bytes.

        Parameters
        ----------
        received : bytes
            The next bytes of the stream.

        Returns
        -------
        list of bytes
            Frames in their order, empty for one that was cut or longer than any frame. What is in them is checked where
            they are decoded.
        """
        frames = []
        *ended, rest = received.split(b"\0")
        for packet in ended:
            self._add(packet)
            if self._broken:
                frames.append(b"")
            elif self._packet[1:]:  # a code alone is an empty frame, and nothing is one, too
                frames.append(from_stream(bytes(self._packet)) or b"")
            self._packet.clear()
            self._broken = False
        self._add(rest)
        return frames

    def _add(self, packet: bytes) -> None:
        if len(self._packet) + len(packet) > LONGEST:
            self._broken = True
            self._packet.clear()
        if not self._broken:
            self._packet += packet

"""An attacker on the path between host and target: it passes frames on, and adds, repeats or changes what it likes."""

from __future__ import annotations

import select
import socket
import struct
import threading
import zlib
from collections.abc import Callable
from types import TracebackType
from typing import Self

from amb_core.rig.link import FrameType

LARGEST = 2048
_PERIOD = 2e-3  # s
Attack = Callable[["OnPath", bytes, bool], list[bytes]]
"""What the attacker sends to the host instead of a frame of the target, or, if the flag is set, in addition to nothing:
then the frame is empty, and asked for every two milliseconds."""


class OnPath:
    """Forwards datagrams between hosts and a target on this machine.

    Attributes
    ----------
    port : int
        Where hosts connect.
    attack : callable
        Replaced at any time; see `Attack`.
    latest : dict of int to bytes
        The latest frame of the target of each type.
    first : dict of int to bytes
        The first one.
    """

    def __init__(self, target_port: int) -> None:
        self._target = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._target.connect(("127.0.0.1", target_port))
        self._host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._host.bind(("127.0.0.1", 0))
        self.port: int = self._host.getsockname()[1]
        self.attack: Attack = leave_alone
        self.latest: dict[int, bytes] = {}
        self.first: dict[int, bytes] = {}
        self._peer: tuple[str, int] | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._target.close()
        self._host.close()

    def _run(self) -> None:
        while not self._ended.is_set():
            ready = select.select([self._host, self._target], [], [], _PERIOD)[0]
            try:
                if self._host in ready:
                    frame, self._peer = self._host.recvfrom(LARGEST)
                    self._target.send(frame)
                if self._target in ready:
                    frame = self._target.recv(LARGEST)
                    self.latest[frame[5]] = frame
                    self.first.setdefault(frame[5], frame)
                    self._pass_on(self.attack(self, frame, False))
            except ConnectionError:  # nobody listens for the moment
                continue
            self._pass_on(self.attack(self, b"", True))

    def _pass_on(self, frames: list[bytes]) -> None:
        for frame in frames if self._peer is not None else ():
            self._host.sendto(frame, self._peer)


def leave_alone(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """No attack."""
    return [] if extra else [frame]


def resummed(frame: bytes) -> bytes:
    """With the checksum that it should have."""
    return frame[:-4] + struct.pack("<I", zlib.crc32(frame[:-4]))


def _forged_counter(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """Descriptions with the nonce of the target and a counter far ahead, before and after each genuine one."""
    described = path.latest.get(FrameType.DESCRIPTION)
    if described is None:
        return leave_alone(path, frame, extra)
    forged = resummed(described[:56] + struct.pack("<Q", 1 << 61) + described[64:])
    return [forged] if extra else [forged, frame, forged]


def _forged_boot(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """Descriptions of a boot that never was."""
    described = path.latest.get(FrameType.DESCRIPTION)
    if described is None:
        return leave_alone(path, frame, extra)
    forged = resummed(described[:8] + b"BOOT" + described[12:40] + b"BOOT" + described[44:])
    return [forged] if extra else [forged, frame]


def _repeated_description(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """The first genuine description again and again."""
    described = path.first.get(FrameType.DESCRIPTION)
    return ([described] if described else []) if extra else [*([described] if described else []), frame]


def _forged_life(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """Status and telemetry without end, as if the target were there."""
    again = [path.latest[kind] for kind in (FrameType.STATUS, FrameType.TELEMETRY) if kind in path.latest]
    return again if extra else [*again, frame]


def _changed_replies(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """Replies with other codes and counters, before the genuine ones."""
    if extra or frame[5] != FrameType.REPLY:
        return leave_alone(path, frame, extra)
    return [
        resummed(frame[:24] + bytes([frame[24] ^ 1]) + frame[25:]),
        resummed(frame[:33] + b"\1" + frame[34:]),
        frame,
    ]


def _repeated_replies(path: OnPath, frame: bytes, extra: bool) -> list[bytes]:
    """Old replies, among them the first."""
    old = [path.first[FrameType.REPLY]] if FrameType.REPLY in path.first else []
    return old if extra else [*old, frame, frame]


ATTACKS: dict[str, Attack] = {
    "forged counter": _forged_counter,
    "forged boot": _forged_boot,
    "repeated description": _repeated_description,
    "forged life": _forged_life,
    "changed replies": _changed_replies,
    "repeated replies": _repeated_replies,
}

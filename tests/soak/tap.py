"""A tap between bridge and target: passes frames on, watches the reference, can send hostile copies to the host.

It sees what the target sends also while no host lives.
"""

from __future__ import annotations

import random
import socket
import threading
import time
from types import TracebackType
from typing import Self

import numpy as np

from amb_core.rig.link import Description, Session, TelemetryBlock, decode

LARGEST = 2048


class Tap:
    """Forwards datagrams between a host and a target on this machine.

    Attributes
    ----------
    steepest : float
        Largest change of a reference between two consecutive samples of a levitated rotor (m).
    hostile : int
        Mutated frames that were sent to the host.
    """

    def __init__(self, target_port: int) -> None:
        self._target = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._target.connect(("127.0.0.1", target_port))
        self._host = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._host.bind(("127.0.0.1", 0))
        self.port: int = self._host.getsockname()[1]
        for end in (self._target, self._host):
            end.settimeout(0.2)
        self._peer: tuple[str, int] | None = None
        self._session: Session | None = None
        self._last: TelemetryBlock | None = None
        self._ended = threading.Event()
        self._draw = random.Random(1)
        self._flood = threading.Event()
        self._seen: list[bytes] = []
        self.steepest, self.hostile, self.samples = 0.0, 0, 0
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._up, self._down, self._attack)]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._target.close()
        self._host.close()

    def attack(self, on: bool) -> None:
        """Begin or end a flood of mutated frames to the host."""
        (self._flood.set if on else self._flood.clear)()

    def _up(self) -> None:
        while not self._ended.is_set():
            try:
                frame, self._peer = self._host.recvfrom(LARGEST)
                self._target.send(frame)
            except OSError:
                continue

    def _down(self) -> None:
        while not self._ended.is_set():
            try:
                frame = self._target.recv(LARGEST)
            except OSError:
                continue
            if self._peer is not None:
                self._host.sendto(frame, self._peer)
            self._watch(frame)
            self._seen = [*self._seen[-40:], frame]

    def _watch(self, frame: bytes) -> None:
        answer = decode(frame, self._session)
        if isinstance(answer, Description) and not answer.first_axis:
            self._session = answer.session()
        if not isinstance(answer, TelemetryBlock) or answer.status is None:
            return
        state = answer.status & 7
        if not ((state >= 1) & (state <= 3)).all():
            self._last = None
            return
        self.samples += answer.steps
        reference = answer.reference
        last = self._last
        if last is not None and last.first_step + last.steps == answer.first_step:
            reference = np.vstack([last.reference[-1:], reference])
        if len(reference) > 1:
            self.steepest = max(self.steepest, float(np.abs(np.diff(reference, axis=0)).max()))
        self._last = answer

    def _attack(self) -> None:
        """Mutated copies of frames of the target, as fast as a hundred at a time go."""
        while not self._ended.is_set():
            if not self._flood.wait(0.1) or self._peer is None or not self._seen:
                continue
            for _ in range(100):
                self._host.sendto(self._mutated(self._draw.choice(self._seen)), self._peer)
                self.hostile += 1
            time.sleep(1e-3)

    def _mutated(self, frame: bytes) -> bytes:
        draw = self._draw
        kind = draw.randrange(4)
        if kind == 0:
            return draw.randbytes(draw.randrange(len(frame) + 64))
        if kind == 1:
            return frame[: draw.randrange(len(frame))]
        changed = bytearray(frame)
        for _ in range(draw.randrange(1, 6)):
            changed[draw.randrange(len(changed))] = draw.randrange(256)
        if kind == 3:  # with a right checksum: its fields are what is wrong
            import zlib

            changed[-4:] = zlib.crc32(bytes(changed[:-4])).to_bytes(4, "little")
        return bytes(changed)

"""A host on a plain UDP socket, and the emulator that it commands, both in this thread."""

from __future__ import annotations

import select
import socket
from typing import Any, Self

import numpy as np

from amb_core.ground.parameters import validate
from amb_core.loop.control import ControllerParameters
from amb_core.loop.records import LoopRecord
from amb_core.plant import PlantParameters
from amb_core.rig.emulation import Address, FaultParameters, LimitParameters, TargetEmulator, reference_library
from amb_core.rig.link import (
    Answer,
    Command,
    CommandWriter,
    Description,
    Refusal,
    Reply,
    TelemetryBlock,
    Upload,
    commands,
    decode,
    hello,
)

BLOCK = 10
TIMEOUT = 60.0  # s
PATIENT = {"host_time": 1e3}
"""Limits of a target that waits for its host: time is that of the emulator, which does not wait."""


class Bench:
    """An emulator without pace, and a host; what the target sends is kept in `answers`."""

    def __init__(
        self,
        plant: PlantParameters | None = None,
        controller: ControllerParameters | None = None,
        limits: dict[str, float] | None = None,
        key: bytes = b"",
        host_key: bytes | None = None,
        plant_waits: bool = True,
        host_patience: float = 0.0,
        **faults: Any,
    ) -> None:
        self.faults = validate(FaultParameters, faults)
        self.emulator = TargetEmulator(
            plant or PlantParameters(),
            controller or ControllerParameters(),
            validate(LimitParameters, PATIENT | (limits or {})),
            self.faults,
            reference_library(),
            Address(port=0, key=key),
            host_patience,
            plant_waits,
        )
        self._key = key if host_key is None else host_key
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.answers: list[Answer | Refusal] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *problem: object) -> None:
        self.socket.close()
        self.emulator.close()

    def set_faults(self, **faults: Any) -> None:
        self.faults = validate(FaultParameters, faults)
        self.emulator.configure(self.faults)

    def connect(self) -> Description:
        self.send(hello())
        description = decode(self._next())
        assert isinstance(description, Description)
        self.session = description.session(self._key)
        self.writer = CommandWriter(self.session, description.counter)
        return description

    def send(self, frame: bytes) -> None:
        """Send a frame, and let the emulator take it before its next step."""
        self.socket.sendto(frame, ("127.0.0.1", self.emulator.port))
        assert select.select([self.emulator], [], [], TIMEOUT)[0]
        self.emulator.run(0)

    def received(self) -> list[bytes]:
        """Datagrams that have arrived so far."""
        frames = []
        while select.select([self.socket], [], [], 0.0)[0]:
            frames.append(self.socket.recv(2048))
        return frames

    def collect(self) -> None:
        """Keep the answers that have arrived so far."""
        self.answers += [decode(frame, self.session) for frame in self.received()]

    def run(self, steps: int) -> None:
        for _ in range(0, steps, BLOCK):
            self.emulator.run(min(BLOCK, steps))
            self.collect()

    def reply(self) -> Reply:
        """The next reply; what comes before it is kept."""
        while not isinstance(answer := decode(self._next(), self.session), Reply):
            self.answers.append(answer)
        return answer

    def command(self, command: Command) -> Reply:
        """The reply to a command. What the emulator has sent before it has arrived, too."""
        self.send(self.writer.write(command))
        while (reply := self.reply()).counter != self.writer.counter:
            self.answers.append(reply)
        return reply

    def _next(self) -> bytes:
        assert select.select([self.socket], [], [], TIMEOUT)[0]
        return self.socket.recv(2048)

    def done(self, *every: Command) -> None:
        for command in every:
            assert self.command(command).code == 0, command.type

    def upload(self, upload: Upload) -> None:
        self.done(upload.begin)
        for chunk in range(upload.chunks):
            self.send(self.writer.write(upload.chunk(chunk)))
        self.done(upload.commit)

    def levitate(self, rows: int = 5, options: int = 1) -> int:
        """Levitate from the next step onwards, which is returned, with telemetry."""
        self.run(BLOCK)
        self.done(commands.stream(rows, options), commands.levitate(0.0))
        return self.emulator.steps

    def blocks(self) -> list[TelemetryBlock]:
        """All telemetry that the emulator has sent, without faults of the network at present."""
        self.done(commands.heartbeat())
        return [answer for answer in self.answers if isinstance(answer, TelemetryBlock)]

    def record(self, first: int, steps: int) -> LoopRecord:
        """The samples from a step of the target onwards, numbered from 0."""
        blocks = [block for block in self.blocks() if block.first_step >= first]
        signals = (np.concatenate([getattr(block, name) for block in blocks])[:steps] for name in SIGNALS)
        assert [block.first_step for block in blocks] == [first + 5 * number for number in range(len(blocks))]
        plant = self.emulator.plant
        return LoopRecord(0, plant.sample_time, *signals, plant.machine.axis_names)


SIGNALS = ("reference", "position", "current")

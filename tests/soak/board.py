"""The port to a Cortex-M7 in QEMU beside the host's build of the same code, in lock-step with one emulated plant.

`python -m tests.soak.board` prints the figures of the table in target/PORTING.md.
"""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.plant import Plant, PlantParameters
from amb_core.rig.emulation.library import reference_library
from amb_core.rig.emulation.switched_plant import SwitchedPlant
from amb_core.rig.link import (
    Code,
    Command,
    CommandWriter,
    Description,
    FrameType,
    Law,
    ReferenceTarget,
    TargetState,
    TelemetryBlock,
    Upload,
    commands,
    decode,
    excitation_upload,
    hello,
    machine_of,
)
from amb_core.rig.link.answers import Reply
from amb_core.rig.link.frames import Frame, decode_frame
from amb_core.rig.link.layout import COUNTER, NONCE, TAG, UploadKind
from tests.qemu_board import Answer, Board, build, size
from tests.target_rig import Exchanged, Stepped, rows_of_exchange

LIFT = 60  # steps
TEMPERATURE = 20.0  # deg C


@dataclass
class Compared:
    """Frames and steps of the board, and those that equal the host's build to the last bit; its largest needs."""

    frames: int = 0
    frames_equal: int = 0
    steps: int = 0
    steps_equal: int = 0
    instructions: int = 0
    instructions_state_space: int = 0
    stack_bytes: int = 0

    def note(self, answer: Answer, twin: ReferenceTarget, state_space: bool = False) -> None:
        """Compare a step."""
        self.steps += 1
        self.steps_equal += (
            np.asarray(answer.current).tobytes() == twin.current.tobytes()
            and answer.enabled == twin.enabled
            and answer.hardware_enable == twin.hardware_enable
        )
        if state_space:
            self.instructions_state_space = max(self.instructions_state_space, answer.instructions)
        else:
            self.instructions = max(self.instructions, answer.instructions)
        self.stack_bytes = max(self.stack_bytes, answer.stack)


class Beside:
    """A board and the host's build, which get the same frames and measurements; the plant follows the board."""

    def __init__(self, board: Board, nonce: bytes, compared: Compared | None = None) -> None:
        self.compared = compared or Compared()
        self._board = board
        self._plant = SwitchedPlant(Plant(PlantParameters()))
        board.send(hello())
        page = decode(board.receive())
        assert isinstance(page, Description)
        self.twin = ReferenceTarget(
            reference_library(), machine_of([page]), page.limits, coils=page.coils, waveform_bytes=page.waveform_bytes,
            nonce=nonce,
        )  # fmt: skip
        self.twin.feed(hello())
        self.twin.take()  # the board describes itself by another name
        self._session = page.session(b"")
        self._writer = CommandWriter(self._session, page.counter)
        self.positions: list[tuple[float, ...]] = []
        self.telemetry: list[tuple[TelemetryBlock, TelemetryBlock]] = []  # of the board, and of the host's build
        self.state_space = False
        self.replies: list[Reply] = []  # to the commands of the recorded exchange

    def send(self, frame: bytes) -> Reply | None:
        """One frame to both; the latest reply of the board."""
        self._board.send(frame)
        self.twin.feed(frame)
        return self._take()

    def command(self, command: Command) -> Reply:
        """One command to both; it must be done."""
        reply = self.send(self._writer.write(command))
        assert reply is not None
        assert reply.code in (Code.DONE, Code.BUSY), (command.type, reply.code)
        return reply

    def run(self, steps: int) -> None:
        """So many steps, with a sign of life before every hundredth."""
        for _ in range(steps):
            if self.twin.steps % 100 == 99:
                self.command(commands.heartbeat())
            plant = self._plant
            self.positions.append(tuple(plant.position))
            answer = self.step([*plant.position], [*plant.coil_current], bool(plant.fault))
            plant.advance(answer.enabled, np.asarray(answer.current))

    def step(self, position: list[float], coil: list[float], fault: bool = False) -> Answer:
        """One step of both with the same measurement."""
        twin, time = self.twin, round(self.twin.steps * 1e5)
        answer = self._board.step(time, position, coil, TEMPERATURE, fault)
        twin.position[:], twin.coil_current[:] = position, coil
        twin.step(time, TEMPERATURE, fault)
        self.compared.note(answer, twin, self.state_space)
        self._take()
        return answer

    def repeat(self, recorded: Exchanged) -> Reply | None:
        """The reply to a recorded command, sealed for this boot; to a HELLO, which is sent as it is, None."""
        frame = decode_frame(recorded.frame)
        assert isinstance(frame, Frame)
        body = frame.payload[COUNTER:-TAG]
        if frame.type is FrameType.HELLO:
            self._board.send(recorded.frame)
            self.twin.feed(recorded.frame)
            self._board.receive()
            self.twin.take()  # the board describes itself by another name
            return None
        if frame.type is FrameType.CURRENT:
            return self.send(commands.current(self._session, self.twin.steps - 1, np.frombuffer(body).tolist()))
        return self.send(self._writer.write(Command(frame.type, body, frame.step)))

    def upload(self, upload: Upload) -> None:
        """Bring an upload to both."""
        self.command(upload.begin)
        for chunk in range(upload.chunks):
            self.send(self._writer.write(upload.chunk(chunk)))
        while self.command(upload.commit).code is Code.BUSY:
            pass

    def excite(self, samples: NDArray[np.float64], after: int) -> None:
        """Upload an excitation and arm it so many steps ahead."""
        self.upload(excitation_upload(1, samples))
        self.command(commands.arm(1, self.twin.steps + after))

    def _take(self) -> Reply | None:
        reply = None
        for expected, _ in self.twin.take():
            frame = self._board.receive()
            self.compared.frames += 1
            self.compared.frames_equal += frame == expected
            answer, of_twin = decode(frame, self._session), decode(expected, self._session)
            if isinstance(answer, TelemetryBlock) and isinstance(of_twin, TelemetryBlock):
                self.telemetry.append((answer, of_twin))
            reply = answer if isinstance(answer, Reply) else reply
        return reply


def beside(image: Path, excited: int) -> tuple[Compared, Beside]:
    """Levitate, excite for so many steps, and land; what was compared."""
    nonce = b"\1" + os.urandom(NONCE - 1)
    with Board(image, nonce) as board:
        both = Beside(board, nonce)
        both.run(3)
        both.command(commands.stream(10, 7))
        both.command(commands.levitate(1e-4 * LIFT))
        both.run(2 * LIFT)
        assert both.command(commands.heartbeat()).status.state is TargetState.LEVITATED
        steps = np.arange(excited)
        both.excite(2e-6 * np.sin(2e-2 * np.pi * np.stack([steps, 1.3 * steps], axis=1)), 5)
        both.run(excited + 10)
        both.command(commands.delevitate(0.001))
        both.run(20)
        assert both.command(commands.heartbeat()).status.state is TargetState.OFF
        _state_space(both)
    both.replies = exchanged(image, both.compared)
    return both.compared, both


def _state_space(both: Beside) -> None:
    """The longest steps of the largest state-space controller: the first one, and those at the limit of the current."""
    axes, order = 2, 23  # n^2 + 8 n + 8 numbers of at most 768
    numbers = np.zeros(order * order + 8 * order + 8)
    proportional = order * order + 4 * order  # after A, B and C
    numbers[proportional], numbers[proportional + axes + 1] = 20_000.0, 20_000.0
    both.upload(Upload(2, UploadKind.STATE_SPACE, numbers.tobytes(), order, axes, 0))
    both.command(commands.controller(Law.STATE_SPACE))
    both.state_space = True
    both.command(commands.levitate())
    for _ in range(3):
        both.step([200e-6, -200e-6], [0.0] * 4)
    both.state_space = False
    both.command(commands.delevitate())
    both.command(commands.controller(Law.PD))


def exchanged(image: Path, compared: Compared) -> list[Reply]:
    """Frames and steps of the recorded exchange, to a board that has just started; its replies."""
    nonce = b"\1" + os.urandom(NONCE - 1)
    with Board(image, nonce) as board:
        both = Beside(board, nonce, compared)
        for row in rows_of_exchange():
            if isinstance(row, Stepped):
                both.step(list(row.position), list(row.coil_current))
            elif row.from_host and (reply := both.repeat(row)) is not None:
                both.replies.append(reply)
    return both.replies


def main() -> None:
    """Print everything that was measured."""
    with tempfile.TemporaryDirectory(prefix="amb_board") as folder:
        image = build(Path(folder))
        comparison, _ = beside(image, 2_000)
        print(json.dumps(asdict(comparison) | asdict(size(image)), indent=1))


if __name__ == "__main__":
    main()

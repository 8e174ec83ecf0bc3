"""The port to a Cortex-M7 in QEMU beside the host's build of the same code, in lock-step with one emulated plant.

`python -m tests.soak.board` prints the figures of the table in target/PORTING.md.
"""

from __future__ import annotations

import json
import os
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.plant import Plant, PlantParameters
from amb_core.rig.emulation.library import reference_library
from amb_core.rig.emulation.switched_plant import SwitchedPlant
from amb_core.rig.link import (
    Command,
    CommandWriter,
    Description,
    ReferenceTarget,
    TargetState,
    commands,
    decode,
    excitation_upload,
    hello,
    machine_of,
)
from amb_core.rig.link.answers import Reply
from amb_core.rig.link.layout import NONCE
from tests.qemu_board import Answer, Board, build, missing, size

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
    stack_bytes: int = 0

    def note(self, answer: Answer, twin: ReferenceTarget) -> None:
        """Compare a step."""
        self.steps += 1
        self.steps_equal += (
            np.asarray(answer.current).tobytes() == twin.current.tobytes()
            and answer.enabled == twin.enabled
            and answer.hardware_enable == twin.hardware_enable
        )
        self.instructions = max(self.instructions, answer.instructions)
        self.stack_bytes = max(self.stack_bytes, answer.stack)


class Beside:
    """A board and the host's build, which get the same frames and measurements; the plant follows the board."""

    def __init__(self, board: Board, nonce: bytes) -> None:
        self.compared = Compared()
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

    def send(self, frame: bytes) -> Reply | None:
        """One frame to both; the latest reply of the board."""
        self._board.send(frame)
        self.twin.feed(frame)
        return self._take()

    def command(self, command: Command) -> Reply:
        """One command to both; it must be done."""
        reply = self.send(self._writer.write(command))
        assert reply is not None
        assert reply.code == 0, (command.type, reply.code)
        return reply

    def run(self, steps: int) -> None:
        """So many steps, with a sign of life before every hundredth."""
        for _ in range(steps):
            if self.twin.steps % 100 == 99:
                self.command(commands.heartbeat())
            plant, twin = self._plant, self.twin
            time, position, coil = round(twin.steps * 1e5), [*plant.position], [*plant.coil_current]
            answer = self._board.step(time, position, coil, TEMPERATURE, bool(plant.fault))
            twin.position[:], twin.coil_current[:] = position, coil
            twin.step(time, TEMPERATURE, bool(plant.fault))
            self.compared.note(answer, twin)
            self._take()
            plant.advance(answer.enabled, np.asarray(answer.current))
            self.positions.append(tuple(position))

    def excite(self, samples: NDArray[np.float64], after: int) -> None:
        """Upload an excitation and arm it so many steps ahead."""
        upload = excitation_upload(1, samples)
        self.command(upload.begin)
        for chunk in range(upload.chunks):
            self.send(self._writer.write(upload.chunk(chunk)))
        self.command(upload.commit)
        self.command(commands.arm(1, self.twin.steps + after))

    def _take(self) -> Reply | None:
        reply = None
        for expected, _ in self.twin.take():
            found = self._board.receive()
            self.compared.frames += 1
            self.compared.frames_equal += found == expected
            answer = decode(found, self._session)
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
    return both.compared, both


def board(excited: int = 2_000) -> dict[str, Any]:
    """Figures of the board; none where it cannot be run."""
    if reason := missing():
        print(f"board: not measured, {reason}", flush=True)
        return {}
    with tempfile.TemporaryDirectory(prefix="amb_board") as folder:
        found, _ = beside(build(Path(folder)), excited)
    return {
        "board": {
            "frames": found.frames + found.steps,
            "equal": found.frames_equal + found.steps_equal,
            "instructions_worst": found.instructions,
            "stack_bytes": found.stack_bytes,
        }
    }


def main() -> None:
    """Print everything that was measured."""
    with tempfile.TemporaryDirectory(prefix="amb_board") as folder:
        image = build(Path(folder))
        found, _ = beside(image, 2_000)
        print(json.dumps(asdict(found) | asdict(size(image)), indent=1))


if __name__ == "__main__":
    main()

"""A model identified from what the board in QEMU has sent, and one from what the host's build of it has sent.

`python -m tests.soak.board_model` prints the figures.
"""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.excitation import Multisine, generate
from amb_core.identification import Identification, identify
from amb_core.loop.control import ControllerParameters
from amb_core.loop.machine import Machine
from amb_core.loop.records import LoopRecord
from amb_core.plant import Plant, PlantParameters
from amb_core.rig.link import TelemetryBlock, TelemetryOption, commands
from amb_core.rig.link.layout import NONCE
from tests.qemu_board import Board, build, missing
from tests.soak.board import LIFT, Beside, beside

STEPS = 8_000
SETTLED = 400  # steps after the lift
ORDER = 6
ROWS = 25  # samples a frame


def identified(image: Path, steps: int = STEPS, order: int = ORDER) -> dict[str, Any]:
    """Excite the levitated rotor of the board for so many steps, and identify a model from its telemetry.

    Parameters
    ----------
    image : Path
        From `tests.qemu_board.build`.
    steps : int, optional
        Steps of the multisine.
    order : int, optional
        States of the model.
    """
    nonce = b"\1" + os.urandom(NONCE - 1)
    machine = Plant(PlantParameters()).machine
    with Board(image, nonce) as board:
        both = Beside(board, nonce)
        both.run(3)
        both.command(commands.stream(ROWS, TelemetryOption.FLOAT64 | TelemetryOption.STATUS))
        both.command(commands.levitate(1e-4 * LIFT))
        both.run(LIFT + SETTLED)
        first = both.twin.steps + 5
        both.excite(multisine(steps, machine), 5)
        both.run(steps + 2 * ROWS)
    records = [record_of(blocks, first, steps, machine) for blocks in zip(*both.telemetry, strict=True)]
    of_board, of_host = (identify(record, order, controller=ControllerParameters()) for record in records)
    return {
        "samples": records[0].steps,
        "samples_equal": int(np.sum(same_rows(*records))),
        "models_equal": same(of_board, of_host),
        "fit_percent": min(float(fit) for fit in of_board.validation.fit),
    }


def multisine(steps: int, machine: Machine) -> NDArray[np.float64]:
    """Lines of both axes between each other, up to 500 Hz: shape (steps, axes), in m."""
    wanted = Multisine(amplitude=5e-6, duration=1e-4 * steps, frequency_start=10.0, frequency_end=500.0,
                       interleaved=True, phasing="schroeder")  # fmt: skip
    return generate(wanted, machine.sample_rate, machine).samples


def record_of(blocks: tuple[TelemetryBlock, ...], first: int, steps: int, machine: Machine) -> LoopRecord:
    """Samples of the target from a step onwards, as a record."""
    reference, position, current = (
        np.concatenate([getattr(block, name) for block in blocks]) for name in ("reference", "position", "current")
    )
    rows = slice(first - blocks[0].first_step, first - blocks[0].first_step + steps)
    return LoopRecord(
        0, 1.0 / machine.sample_rate, reference[rows], position[rows], current[rows], machine.axis_names
    )  # fmt: skip


def same_rows(one: LoopRecord, other: LoopRecord) -> NDArray[np.bool_]:
    """Whether each sample equals the other's to the last bit; shape (steps,)."""
    pairs = [(getattr(one, name), getattr(other, name)) for name in ("reference", "position", "current")]
    return np.logical_and.reduce([(a.view(np.uint64) == b.view(np.uint64)).all(axis=1) for a, b in pairs])


def same(one: Identification, other: Identification) -> bool:
    """Whether two models are the same to the last bit."""
    names = ("a", "b", "c", "d", "k", "input_offset", "output_offset", "innovation_covariance")
    return all(getattr(one.model, name).tobytes() == getattr(other.model, name).tobytes() for name in names)


def board(excited: int = 2_000, multisine_steps: int = STEPS) -> dict[str, Any]:
    """Figures of the board; none where it cannot be run."""
    if reason := missing():
        print(f"board: not measured, {reason}", flush=True)
        return {}
    with tempfile.TemporaryDirectory(prefix="amb_board") as folder:
        image = build(Path(folder))
        comparison, _ = beside(image, excited)
        return {
            "board": {
                "frames": comparison.frames + comparison.steps,
                "equal": comparison.frames_equal + comparison.steps_equal,
                "instructions_worst": comparison.instructions,
                "instructions_state_space": comparison.instructions_state_space,
                "stack_bytes": comparison.stack_bytes,
                "identified": identified(image, multisine_steps),
            }
        }


def main() -> None:
    """Print what was measured."""
    with tempfile.TemporaryDirectory(prefix="amb_board") as folder:
        print(json.dumps(identified(build(Path(folder))), indent=1))


if __name__ == "__main__":
    main()

"""amb_msgs/LoopSamples: a block of telemetry, of this version or of 0.1."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import BagError, bounded
from amb_core.loop.machine import LONGEST_NAME
from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.arrays import doubles
from amb_core.recording.messages.time_stamp import LONGEST_TIME, set_step_time

M = TypeVar("M", bound=Any)

LOOP_SAMPLES = "amb_msgs/msg/LoopSamples"
SHORTEST_SAMPLE_TIME, LONGEST_SAMPLE_TIME = 1e-7, 10.0  # s; wider than for any loop; prevents overflows later
SIGNALS = ("reference", "position", "current")


def block_from_message(message: Any) -> LoopRecord:
    """The samples of a LoopSamples message.

    Raises
    ------
    BagError
        If it has no steps, no axes or two of one name, its arrays differ in length, or its sample time or step is out
        of range.
    """
    where = f"telemetry block of run {message.run} at step {message.first_step}"
    names, signals = _first_layout(message) if hasattr(message, "position_x") else _by_axis(message)
    if len({len(column) for columns in signals for column in columns}) > 1:
        raise BagError(f"{where}: its arrays must have the same length")
    if not names or not all(names) or len(set(names)) < len(names) or max(map(len, names)) > LONGEST_NAME:
        raise BagError(
            f"{where}: its axes have the names {bounded(str(list(names)), 200)}; allowed: at least one axis, each with "
            f"its name of at most {LONGEST_NAME} characters"
        )
    if not len(signals[0][0]):
        raise BagError(f"{where}: it has no steps; allowed: 1 or more")
    reference, position, current = map(_columns, signals)
    block = LoopRecord(int(message.first_step), float(message.sample_time), reference, position, current, names)
    if not SHORTEST_SAMPLE_TIME <= block.sample_time <= LONGEST_SAMPLE_TIME:
        raise BagError(
            f"{where}: sample time {block.sample_time} s must be positive; allowed: {SHORTEST_SAMPLE_TIME:g} s to "
            f"{LONGEST_SAMPLE_TIME:g} s"
        )
    if (block.first_step + block.steps) * block.sample_time > LONGEST_TIME:
        raise BagError(f"{where}: its time exceeds the range of a ROS time stamp, {LONGEST_TIME} s")
    return block


def steps_in(message: Any) -> int:
    """Number of samples in a LoopSamples message, by its first axis."""
    return len(message.axes[0].position) if message.axes else 0


def fill_loop_samples(message: M, axis: Callable[[], Any], run: int, block: LoopRecord) -> M:
    """Set the fields of a LoopSamples message to the samples of a block, and its stamp to the time of the first.

    `axis` makes an empty AxisSamples message.
    """
    message.run, message.first_step, message.sample_time = run, block.first_step, block.sample_time
    message.axes = [axis() for _ in block.axes]
    for column, part in enumerate(message.axes):
        part.name = block.axes[column]
        for name in SIGNALS:
            setattr(part, name, doubles(getattr(block, name)[:, column]))
    set_step_time(message.header.stamp, block.first_step, 1.0 / block.sample_time)
    return message


def _by_axis(message: Any) -> tuple[tuple[str, ...], list[list[Any]]]:
    """Names of the axes, and the arrays of each signal, axis by axis."""
    names = tuple(str(axis.name) for axis in message.axes)
    return names, [[getattr(axis, name) for axis in message.axes] for name in SIGNALS]


def _first_layout(message: Any) -> tuple[tuple[str, ...], list[list[Any]]]:
    """The same of a message of version 0.1, which has the axes x and y only."""
    return ("x", "y"), [[getattr(message, f"{name}_{axis}") for axis in "xy"] for name in SIGNALS]


def _columns(arrays: list[Any]) -> NDArray[np.float64]:
    return np.column_stack([np.asarray(samples, dtype=np.float64) for samples in arrays])

"""amb_msgs/LoopSamples: a block of telemetry."""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from amb_core.errors import BagError
from amb_core.loop.records import LoopRecord
from amb_core.recording.messages.arrays import doubles
from amb_core.recording.messages.time_stamp import LONGEST_TIME, set_step_time

M = TypeVar("M", bound=Any)

LOOP_SAMPLES = "amb_msgs/msg/LoopSamples"
SHORTEST_SAMPLE_TIME, LONGEST_SAMPLE_TIME = 1e-7, 10.0  # s; wider than for any loop; prevents overflows later
_SIGNALS = ("reference", "position", "current")


def block_from_message(message: Any) -> LoopRecord:
    """The samples of a LoopSamples message.

    Raises
    ------
    BagError
        If its arrays differ in length, or its sample time or step is out of range.
    """
    where = f"telemetry block of run {message.run} at step {message.first_step}"
    try:
        block = LoopRecord(
            int(message.first_step),
            float(message.sample_time),
            _axes(message.reference_x, message.reference_y),
            _axes(message.position_x, message.position_y),
            _axes(message.current_x, message.current_y),
        )
    except ValueError:
        raise BagError(f"{where}: its arrays must have the same length") from None
    if not SHORTEST_SAMPLE_TIME <= block.sample_time <= LONGEST_SAMPLE_TIME:
        raise BagError(
            f"{where}: sample time {block.sample_time} s must be positive; allowed: {SHORTEST_SAMPLE_TIME:g} s to "
            f"{LONGEST_SAMPLE_TIME:g} s"
        )
    if (block.first_step + block.steps) * block.sample_time > LONGEST_TIME:
        raise BagError(f"{where}: its time exceeds the range of a ROS time stamp, {LONGEST_TIME} s")
    return block


def fill_loop_samples(message: M, run: int, block: LoopRecord) -> M:
    """Set the fields of a LoopSamples message to the samples of a block, and its stamp to the time of the first."""
    message.run, message.first_step, message.sample_time = run, block.first_step, block.sample_time
    for name in _SIGNALS:
        samples = getattr(block, name)
        for column, axis in enumerate("xy"):
            setattr(message, f"{name}_{axis}", doubles(samples[:, column]))
    set_step_time(message.header.stamp, block.first_step, 1.0 / block.sample_time)
    return message


def _axes(x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
    return np.column_stack([np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)])

"""amb_msgs/PlantState: the internal state of the plant at a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import BagError
from amb_core.loop.records import PlantRecord
from amb_core.recording.messages.arrays import doubles
from amb_core.recording.messages.time_stamp import set_step_time, stamped_time

if TYPE_CHECKING:
    from amb_core.plant import PlantSnapshot

M = TypeVar("M", bound=Any)

PLANT_STATE = "amb_msgs/msg/PlantState"


def plant_record_from_messages(messages: Sequence[Any]) -> PlantRecord:
    """The record of the PlantState messages of one run; at least one message is needed.

    Raises
    ------
    BagError
        If their arrays do not have the sizes of their bearings.
    """
    shape = len(messages), len(messages[0].contact)
    try:
        return PlantRecord(
            step=np.array([message.step for message in messages], dtype=np.int64),
            time=np.array([stamped_time(message.header.stamp) for message in messages]),
            coil_current=_rows(messages, "coil_current").reshape(*shape, 4),
            flux_density=_rows(messages, "flux_density").reshape(*shape, 8),
            force=np.stack([_rows(messages, f"force_{axis}").reshape(shape) for axis in "xy"], axis=2),
            position=np.stack([_rows(messages, f"position_{axis}").reshape(shape) for axis in "xy"], axis=2),
            contact=np.array([message.contact for message in messages], dtype=np.bool_).reshape(shape),
            contact_force=_rows(messages, "contact_force").reshape(shape),
        )
    except ValueError:
        raise BagError(
            f"states of the plant in run {messages[0].run}: the arrays of each must have the sizes of its bearings"
        ) from None


def fill_plant_state(message: M, snapshot: PlantSnapshot, run: int, step: int, sample_rate: float) -> M:
    """Set the fields of a PlantState message to a snapshot at a step of a run; the sample rate (Hz) gives the time."""
    message.run, message.step = run, step
    message.coil_current = doubles(snapshot.coil_current)
    message.flux_density = doubles(snapshot.flux_density)
    for column, axis in enumerate("xy"):
        setattr(message, f"force_{axis}", doubles(snapshot.force[:, column]))
        setattr(message, f"position_{axis}", doubles(snapshot.position[:, column]))
    message.contact = snapshot.contact.tolist()
    message.contact_force = doubles(np.hypot(*snapshot.contact_force.T))
    set_step_time(message.header.stamp, step, sample_rate)
    return message


def _rows(messages: Sequence[Any], name: str) -> NDArray[np.float64]:
    return np.array([getattr(message, name) for message in messages], dtype=np.float64)

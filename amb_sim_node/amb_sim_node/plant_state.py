"""Snapshots of the plant as PlantState messages."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from amb_msgs.msg import PlantState
from amb_ros.stamps import set_step_time

if TYPE_CHECKING:
    from amb_core.plant import PlantSnapshot


def plant_state_message(snapshot: PlantSnapshot, run: int, step: int, sample_rate: float) -> PlantState:
    """The message of a snapshot at a step of a run; `sample_rate` (Hz) gives the simulation time."""
    message = PlantState(
        run=run,
        step=step,
        coil_current=_numbers(snapshot.coil_current),
        flux_density=_numbers(snapshot.flux_density),
        force_x=_numbers(snapshot.force[:, 0]),
        force_y=_numbers(snapshot.force[:, 1]),
        position_x=_numbers(snapshot.position[:, 0]),
        position_y=_numbers(snapshot.position[:, 1]),
        contact=snapshot.contact.tolist(),
        contact_force=_numbers(np.hypot(*snapshot.contact_force.T)),
    )
    set_step_time(message.header.stamp, step, sample_rate)
    return message


def _numbers(values: NDArray[np.float64]) -> array[float]:
    """Row by row, as the type that a message takes without a look at each element."""
    return array("d", values.tobytes())

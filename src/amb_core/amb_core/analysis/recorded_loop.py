"""Content of a bag for a validation: the data, and the parameters of the controller and of the simulated plant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_core.analysis.data_files import data_reader, read_data
from amb_core.analysis.recorded_data import read_bag_data, recorded_data
from amb_core.identification.data import IdentificationData
from amb_core.recording import Recording

if TYPE_CHECKING:
    from amb_core.loop.control import ControllerParameters
    from amb_core.plant import PlantParameters


@dataclass(frozen=True, eq=False)
class RecordedLoop:
    """Data of a loop, and its known parameters.

    Attributes
    ----------
    data : IdentificationData
        The data.
    controller : ControllerParameters or None
        The controller; None if it was not recorded.
    plant : PlantParameters or None
        The simulated plant; None if it was not recorded, as for a real bearing.
    damage : str
        Why a bag cannot be read to its end; empty for a complete one.
    """

    data: IdentificationData
    controller: ControllerParameters | None
    plant: PlantParameters | None
    damage: str = ""


def read_loop(path: str | Path, **options: Any) -> RecordedLoop:
    """Read a bag, or a file that has only data.

    Parameters
    ----------
    path : path
        As for `read_data`.
    **options
        Those of `read_data`.

    Raises
    ------
    BagError, IdentificationError
        If there are no such data.
    ParameterError
        If a recorded parameter is out of its range.
    """
    if data_reader(path, options) is not read_bag_data:
        return RecordedLoop(read_data(path, **options), None, None)
    recording = Recording.read(path)
    return RecordedLoop(
        recorded_data(recording, **options),
        recording.controller_parameters(),
        recording.plant_parameters(),
        recording.truncated,
    )

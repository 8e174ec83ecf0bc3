"""Content of a bag for a validation: the data, and the parameters of the controller and of the simulated plant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from amb_core.analysis.data_files import data_reader, read_data
from amb_core.analysis.recorded_data import read_bag_data, recorded_data
from amb_core.identification.controller_choice import named_controller
from amb_core.identification.data import IdentificationData
from amb_core.recording import Recording

if TYPE_CHECKING:
    from amb_core.loop.known_controller import KnownController
    from amb_core.plant import PlantParameters


@dataclass(frozen=True, eq=False)
class RecordedLoop:
    """Data of a loop, and its known parameters.

    Attributes
    ----------
    data : IdentificationData
        The data.
    controller : KnownController or None
        The controller; None if it was not recorded.
    plant : PlantParameters or None
        The simulated plant; None if it was not recorded, as for a real bearing.
    damage : str
        Why a bag cannot be read to its end; empty for a complete one.
    """

    data: IdentificationData
    controller: KnownController | None
    plant: PlantParameters | None
    damage: str = ""


def read_loop(path: str | Path, controller: str = "", **options: Any) -> RecordedLoop:
    """Read a bag, or a file that has only data.

    Parameters
    ----------
    path : path
        As for `read_data`.
    controller : str, optional
        A controller that replaces the recorded one, see `named_controller`; the limit of the currents remains the
        recorded one where its file holds none.
    **options
        Those of `read_data`.

    Raises
    ------
    BagError, IdentificationError
        If there are no such data.
    ParameterError
        If a recorded parameter is out of its range, or the controller is not available or for another sample rate.
    """
    if data_reader(path, options) is not read_bag_data:
        data = read_data(path, **options)
        named = named_controller(controller, sample_rate=data.sample_rate) if controller else None
        return RecordedLoop(data, named, None)
    recording = Recording.read(path)
    data = recorded_data(recording, **options)
    return RecordedLoop(
        data,
        recorded_controller(recording, data.sample_rate, controller),
        recording.plant_parameters(),
        recording.truncated,
    )


def recorded_controller(recording: Recording, sample_rate: float, named: str = "") -> KnownController | None:
    """The controller that a user names, with the recorded limit of its currents; or the recorded one.

    Raises
    ------
    BagError, IdentificationError, ParameterError
        If it is not available, or for another sample rate (Hz).
    """
    from amb_core.loop.known_controller import LinearControl  # loads a compiler

    if named:
        return named_controller(named, sample_rate=sample_rate, current_limit=recording.current_limit())
    controller = recording.controller()
    return controller.at_rate(sample_rate) if isinstance(controller, LinearControl) else controller

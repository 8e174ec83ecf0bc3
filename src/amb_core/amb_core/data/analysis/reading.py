"""The one reader of data: bags and files of this workbench as they are, everything else by a description.

Commands, the identifier, `AmbClient` and Python code read here, so all of them accept the same files.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from amb_core.data.analysis.bag_table import is_ours, table_of_bag
from amb_core.data.analysis.file_recording import NO_STEPS, FileContent
from amb_core.data.analysis.recorded_clearance import radial_clearance
from amb_core.data.analysis.recorded_data import recorded_data
from amb_core.data.controller_choice import NO_CONTROLLER, named_controller, with_shown_limit
from amb_core.data.experiments import (
    DataDescription,
    DescribedData,
    IdentificationData,
    RecordedLoop,
    describe_tables,
    split_at_invalid,
    written_data,
)
from amb_core.data.tables import ENDINGS, load_content, tables_of
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.file_errors import reading
from amb_core.ground.files.regular_files import is_folder
from amb_core.ground.given_values import path_of
from amb_core.loop.known_controller import KnownController, LinearControl, limited
from amb_core.recording import Recording

_SIGNALS = ("inputs", "outputs", "reference", "topics", "time", "variable")


def read(
    path: str | Path,
    description: DataDescription | str | Path | None = None,
    *,
    run: int | None = None,
    first_step: int = -1,
    steps: int = 0,
    **values: Any,
) -> RecordedLoop:
    """Read a file or bag.

    Parameters
    ----------
    path : str or Path
        A bag; or a text, MAT, NPZ, NPY or Parquet file.
    description : DataDescription or path, optional
        What is known of it, or the file of a saved description. None if nothing is.
    run, first_step, steps : int, optional
        Steps of a bag of this workbench, as for `recorded_data`. Where first_step and steps are given, only this
        stretch of an MCAP bag is read, by its index. By default the last run.
    **values : object
        Fields of the description, such as inputs=["u"], which change it.

    Returns
    -------
    RecordedLoop
        The data, controller and plant where they are known, and what was understood of a file.

    Raises
    ------
    BagError, IdentificationError, ParameterError
        If the data cannot be read, or leave a question; the message names the option that answers it.
    """
    path, known = path_of("path", path, IdentificationError), _description(description, values)
    recording = _bag_at(path, None if first_step < 0 or not steps else (run, first_step, steps))
    if recording is not None and _as_it_is(recording, known):
        recording.clearance = known.clearance
        recorded = recorded_data(recording, run, first_step, steps)
        return _loop(split_at_invalid(recorded) if known.repair == "split" else recorded, known, recording, run)
    if run is not None or first_step != -1 or steps:
        raise IdentificationError(f"data {path}: {NO_STEPS}")
    data, described = _data(path, recording, known)
    damage = "" if recording is None else recording.truncated
    return replace(_loop(data, known), damage=damage, described=described)


def read_recording(
    path: str | Path, description: DataDescription | str | Path | None = None, **values: Any
) -> tuple[Recording, DescribedData | None]:
    """A bag with telemetry as it is, or another file as a recording of one run.

    Parameters
    ----------
    path : str or Path
        A bag; or a text, MAT, NPZ, NPY or Parquet file.
    description : DataDescription or str or Path, optional
        What is known of it, or the file of a saved description; None if nothing is.
    **values : object
        Fields of the description, which change it.

    Returns
    -------
    (Recording, DescribedData or None)
        The recording, and how the columns were understood; None for a bag.

    Raises
    ------
    AmbError
        As for `read`.
    """
    path, known = path_of("path", path, IdentificationError), _description(description, values)
    recording, described = _bag_at(path), None
    if recording is None or not _as_it_is(recording, known):
        data, described = _data(path, recording, known)
        recording = Recording(FileContent(path, data))
        recording.clearance_of_axis = data.clearance
    recording.clearance = known.clearance
    return recording, described


def _description(description: DataDescription | str | Path | None, values: dict[str, Any]) -> DataDescription:
    if not isinstance(description, DataDescription):
        description = DataDescription.load(description) if description else DataDescription.of()
    return description.with_values(**values)


def _bag_at(path: Path, stretch: tuple[int | None, int, int] | None = None) -> Recording | None:
    """The bag at a path, or its stretch of a run by first step and steps; None for a file of one of `ENDINGS`."""
    if path.suffix.lower() in ENDINGS and not is_folder(path):
        return None
    if stretch is None:
        return Recording.read(path)
    run, first_step, steps = stretch
    return Recording.read_stretch(path, run, first_step, first_step + steps)


def _as_it_is(recording: Recording, known: DataDescription) -> bool:
    """Whether a bag is one of this workbench, and nothing else in it is asked for."""
    return not any(getattr(known, name) for name in _SIGNALS) and is_ours(recording)


def _data(
    path: Path, recording: Recording | None, known: DataDescription
) -> tuple[IdentificationData, DescribedData | None]:
    tables = [] if recording is None else [table_of_bag(recording, known.topics, known.columns)]
    with reading("data", path):
        if recording is None:
            content = load_content(path, known.separator, known.decimal)
            if not any(getattr(known, name) for name in _SIGNALS) and (written := written_data(content, known)):
                return _with_clearance(written, known), None
            tables = tables_of(path, content, known.variable, known.columns)
        described = describe_tables(tables, known)
    return _with_clearance(described.data, known), described


def _with_clearance(data: IdentificationData, known: DataDescription) -> IdentificationData:
    """Data with the clearances of their file, and in place of them the one that a user gives."""
    return replace(data, clearance={**data.clearance, **radial_clearance(data.output_names, known.clearance)})


def _loop(
    data: IdentificationData, known: DataDescription, recording: Recording | None = None, run: int | None = None
) -> RecordedLoop:
    """Data with their controller: the named one, or that of the run in the bag."""
    plant = None if recording is None else recording.plant_parameters(run)
    damage = "" if recording is None else recording.truncated
    if known.controller == NO_CONTROLLER:
        return RecordedLoop(replace(data, foreign=True), None, plant, damage)
    if recording is not None:
        controller = recorded_controller(recording, data.sample_rate, known.controller, run)
    else:
        controller = named_controller(known.controller, sample_rate=data.sample_rate) if known.controller else None
    return RecordedLoop(data, controller and with_shown_limit(controller, data), plant, damage)


def recorded_controller(
    recording: Recording, sample_rate: float, named: str = "", run: int | None = None
) -> KnownController | None:
    """The controller that a user names, with the recorded limit of its currents; or the recorded one of a run.

    Parameters
    ----------
    recording : Recording
        A bag, or a file as a recording of one run.
    sample_rate : float
        Sample rate of the loop (Hz).
    named : str, optional
        Name or file of a controller; empty for the recorded one.
    run : int, optional
        Number of the run; by default the last one.

    Returns
    -------
    KnownController or None
        The controller; None if none was recorded.

    Raises
    ------
    BagError, IdentificationError, ParameterError
        If it is not available, or for another sample rate (Hz).
    """
    if named:
        return limited(named_controller(named, sample_rate=sample_rate), recording.current_limit(run))
    controller = recording.controller(run)
    return controller.at_rate(sample_rate) if isinstance(controller, LinearControl) else controller

"""Files of a user: what this workbench has written is read as it is, everything else by a description.

The one place where commands read files. A file becomes data for identification, and for regions, distortion and reports
a recording of one run.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from amb_core.analysis.bag_table import is_ours, table_of_bag
from amb_core.analysis.data_files import read_data
from amb_core.analysis.file_recording import FileContent
from amb_core.analysis.recorded_data import recorded_data
from amb_core.analysis.recorded_loop import RecordedLoop, recorded_controller
from amb_core.errors import IdentificationError
from amb_core.files.arrays import load_arrays
from amb_core.files.file_errors import reading
from amb_core.files.matlab import load_variables
from amb_core.files.regular_files import is_folder, open_regular
from amb_core.identification.controller_choice import NO_CONTROLLER, named_controller
from amb_core.identification.data import READERS, IdentificationData
from amb_core.identification.data.described import DataDescription, DescribedData, describe_table
from amb_core.recording import Recording
from amb_core.tables import ENDINGS, read_table

_ROLES = ("inputs", "outputs", "reference", "topics", "time", "variable")


@dataclass(frozen=True, eq=False)
class OwnFile:
    """A file or bag of a user.

    Attributes
    ----------
    loop : RecordedLoop
        Data, controller and plant, as far as they are known.
    described : DescribedData or None
        What was understood; None for files and bags of this workbench.
    recording : Recording
        The bag, or the file as a recording of one run.
    """

    loop: RecordedLoop
    described: DescribedData | None
    recording: Recording

    @property
    def is_bag_of_ours(self) -> bool:
        """Whether it is a bag with what this workbench records."""
        return not isinstance(self.recording.content, FileContent)


def read_own(path: str | Path, description: DataDescription | None = None, **chosen: Any) -> OwnFile:
    """Read a file or bag.

    Parameters
    ----------
    path : path
        A bag; or a text, MAT, NPZ, NPY or Parquet file.
    description : DataDescription, optional
        What is known of it.
    **chosen
        Run and steps of a bag of this workbench, as for `recorded_data`.

    Raises
    ------
    BagError, IdentificationError, ParameterError
        If the data cannot be read, or leave a question; the message names the option that answers it.
    """
    path, known = Path(path), description or DataDescription.of()
    recording = _recording_of(path)
    if recording is not None and _as_it_is(recording, known):
        data = recorded_data(recording, **chosen)
        return OwnFile(_loop(recording, data, known), None, recording)
    if chosen:
        raise IdentificationError(
            f"data {path}: option {next(iter(chosen))} is not allowed; it is for bags with telemetry of this workbench"
        )
    data, described = _data(path, recording, known)
    damage = "" if recording is None else recording.truncated
    loop = replace(_loop(None, data, known), damage=damage)
    return OwnFile(loop, described, Recording(FileContent(path, data)))


def read_own_recording(
    path: str | Path, description: DataDescription | None = None
) -> tuple[Recording, DescribedData | None]:
    """A bag with telemetry as it is, or any other file as a recording of one run; errors as for `read_own`."""
    path, known = Path(path), description or DataDescription.of()
    recording = _recording_of(path)
    if recording is not None and _as_it_is(recording, known):
        return recording, None
    data, described = _data(path, recording, known)
    return Recording(FileContent(path, data)), described


def _recording_of(path: Path) -> Recording | None:
    """The bag at a path; None for a file of one of `ENDINGS`."""
    return Recording.read(path) if is_folder(path) or path.suffix.lower() not in ENDINGS else None


def _as_it_is(recording: Recording, known: DataDescription) -> bool:
    """Whether a bag is one of this workbench, and nothing else in it is asked for."""
    return not any(getattr(known, name) for name in _ROLES) and is_ours(recording)


def _data(
    path: Path, recording: Recording | None, known: DataDescription
) -> tuple[IdentificationData, DescribedData | None]:
    if recording is None and _is_written_here(path, known):
        return read_data(path, **_for_reader(known)), None
    described = _described(path, recording, known)
    return described.data, described


def _loop(recording: Recording | None, data: IdentificationData, known: DataDescription) -> RecordedLoop:
    """Data with their controller: the named one, or that of the bag."""
    named, plant, damage = known.controller, None, ""
    if recording is not None:
        plant, damage = recording.plant_parameters(), recording.truncated
    if named == NO_CONTROLLER:
        return RecordedLoop(replace(data, foreign=True), None, plant, damage)
    if recording is not None:
        return RecordedLoop(data, recorded_controller(recording, data.sample_rate, named), plant, damage)
    return RecordedLoop(data, named_controller(named, sample_rate=data.sample_rate) if named else None, None)


def _described(path: Path, recording: Recording | None, known: DataDescription) -> DescribedData:
    if recording is None:
        table = read_table(path, known.variable, known.separator, known.decimal)
    else:
        units = [item.rpartition("=")[0] for item in known.units]
        named = [*known.inputs, *known.outputs, *known.reference, known.time, *units]
        table = table_of_bag(recording, known.topics, [name for name in named if name])
    with reading("data", path):
        return describe_table(table, known)


def _is_written_here(path: Path, known: DataDescription) -> bool:
    """Whether a file is one of `write_data`, or has u, y and Ts, and no other signals are asked for."""
    if known.inputs or known.outputs or known.variable or path.suffix.lower() not in READERS:
        return False
    with reading("data", path):
        if path.suffix.lower() == ".csv":
            with open_regular(path) as file:
                return file.read(11).startswith(b"# amb_core ")
        if path.suffix.lower() == ".npz":
            return "inputs_0" in load_arrays(path)
        return {"u", "y", "FirstStep", "InputTrend"} <= set(load_variables(path))


def _for_reader(known: DataDescription) -> dict[str, Any]:
    return {} if known.given_sample_time is None else {"sample_time": known.given_sample_time}

"""Data written to files, and read back from their content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from amb_core.data.experiments.conditioning import split_at_invalid
from amb_core.data.experiments.csv_files import data_of_text, write_csv
from amb_core.data.experiments.dataset import IdentificationData, require_data
from amb_core.data.experiments.description import DataDescription
from amb_core.data.experiments.mat_files import data_of_variables, write_mat
from amb_core.data.experiments.npz_files import data_of_arrays, write_npz
from amb_core.data.tables import Content, Table
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import path_of

_WRITERS: dict[str, Callable[[IdentificationData, Path], None]] = {
    ".csv": write_csv,
    ".npz": write_npz,
    ".mat": write_mat,
}


def write_data(data: IdentificationData, path: str | Path) -> None:
    """Write a `.csv`, `.npz` or `.mat` file, from which `amb_core.data.analysis.read` reads the same data bit for bit.

    Parameters
    ----------
    data : IdentificationData
        Data to write, trends included.
    path : str or Path
        File to write; its extension gives the format.

    Raises
    ------
    IdentificationError
        If the file name extension is not supported, or the file cannot be written.
    """
    require_data(data)
    path = path_of("path", path, IdentificationError)
    if path.suffix.lower() not in _WRITERS:
        raise IdentificationError(f"data {path}: the file name must end in {', '.join(_WRITERS)}")
    try:
        _WRITERS[path.suffix.lower()](data, path)
    except OSError as problem:
        raise IdentificationError(f"data {path}: cannot be written: {problem.strerror}") from None


def written_data(content: Content, description: DataDescription) -> IdentificationData | None:
    """The data of a file of `write_data`; None for another file.

    Parameters
    ----------
    content : Content
        Content of the file.
    description : DataDescription
        What the user says of it.

    Returns
    -------
    IdentificationData or None
        The data, if the file is such a one.

    Raises
    ------
    IdentificationError
        If samples are missing, or its sample time is not the one of the description.
    """
    if isinstance(content, Table):
        data = data_of_text(content)
    else:
        data = data_of_arrays(content) if "inputs_0" in content else data_of_variables(content)
    given = description.given_sample_time
    if data is not None and given is not None and abs(data.sample_time - given) > 1e-6 * given:
        raise IdentificationError(
            f"sample_time {given:g} s is given, but the file has Ts = {data.sample_time:g} s; correct it or leave it "
            "out"
        )
    return split_at_invalid(data) if data is not None and description.repair == "split" else data

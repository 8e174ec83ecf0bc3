"""NumPy archives of data: one array for every field of the data and of its experiments.

The fields of experiment k end in `_k`, as `inputs_0`, `first_step_0`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from amb_core.files.arrays import load_arrays
from amb_core.files.file_errors import reading
from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.experiment import Experiment
from amb_core.identification.data.matrix_data import data_of_matrix, only_matrix

_DATA_FIELDS = ("sample_time", "input_names", "output_names", "input_units", "output_units")
_EXPERIMENT_FIELDS = tuple(item.name for item in fields(Experiment))


def write_npz(data: IdentificationData, path: str | Path) -> None:
    """Write data as an `.npz` archive."""
    arrays = {name: np.asarray(getattr(data, name)) for name in _DATA_FIELDS}
    for index, item in enumerate(data.experiments):
        for name in _EXPERIMENT_FIELDS:
            value = getattr(item, name)
            if value is not None:
                arrays[f"{name}_{index}"] = np.asarray(value)
    with Path(path).open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def read_npz(
    path: str | Path,
    variable: str | None = None,
    inputs: Sequence[int] | None = None,
    outputs: Sequence[int] | None = None,
    sample_time: float | None = None,
) -> IdentificationData:
    """Read an archive of `write_npz`, or one with a matrix whose columns are signals.

    Parameters
    ----------
    path : path
        The file.
    variable : str, optional
        Name of the matrix, if the archive contains more than one.
    inputs, outputs : sequence of int, optional
        Columns of the matrix, counted from 0.
    sample_time : float, optional
        Sample time of the matrix (s).

    Raises
    ------
    IdentificationError
        If the file cannot be read or does not contain the requested data.
    """
    path = Path(path)
    with reading("data", path):
        content: dict[str, Any] = load_arrays(path)
        if inputs is None and outputs is None and "inputs_0" in content:
            return _own(content)
        return data_of_matrix(only_matrix(content, variable), inputs, outputs, sample_time, str(path))


def _own(content: dict[str, Any]) -> IdentificationData:
    """The data of an archive of `write_npz`."""
    experiments = []
    for index in range(sum(name.startswith("inputs_") for name in content)):
        item = {name: content[f"{name}_{index}"] for name in _EXPERIMENT_FIELDS if f"{name}_{index}" in content}
        experiments.append(Experiment(**item | {"first_step": int(item["first_step"]), "source": str(item["source"])}))
    names = (tuple(content[name].tolist()) for name in _DATA_FIELDS[1:])
    return IdentificationData(tuple(experiments), float(content["sample_time"]), *names)

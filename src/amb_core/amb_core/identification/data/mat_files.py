"""MATLAB and Octave files (version 5) of data.

`write_mat` writes the cells `u`, `y` and `r` with one matrix for each experiment, so that in MATLAB
`iddata(y, u, Ts, 'InputName', InputName, 'OutputName', OutputName)` has the same experiments. `read_mat` reads these,
and files of others: matrices or cells `u` and `y`, or one matrix whose columns are signals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.files.file_errors import reading
from amb_core.files.matlab import cell, load_variables, save_variables, texts
from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.experiment import Experiment
from amb_core.identification.data.matrix_data import data_of_matrix, needed_sample_time, only_matrix

_NAMES = {
    "input_names": "InputName",
    "output_names": "OutputName",
    "input_units": "InputUnit",
    "output_units": "OutputUnit",
}
_TRENDS = {"input_trend": "InputTrend", "output_trend": "OutputTrend", "reference_trend": "ReferenceTrend"}


def write_mat(data: IdentificationData, path: str | Path) -> None:
    """Write data as a `.mat` file."""
    variables: dict[str, Any] = {
        "u": cell([item.inputs for item in data.experiments]),
        "y": cell([item.outputs for item in data.experiments]),
        "r": cell([np.empty((0, 0)) if item.reference is None else item.reference for item in data.experiments]),
        "Ts": data.sample_time,
        "FirstStep": np.array([item.first_step for item in data.experiments], dtype=np.float64),
        "Source": cell([item.source for item in data.experiments]),
    }
    variables |= {matlab: cell(list(getattr(data, name))) for name, matlab in _NAMES.items()}
    variables |= {matlab: cell([getattr(item, name) for item in data.experiments]) for name, matlab in _TRENDS.items()}
    save_variables(path, variables)


def read_mat(
    path: str | Path,
    variable: str | None = None,
    inputs: Sequence[int] | None = None,
    outputs: Sequence[int] | None = None,
    sample_time: float | None = None,
) -> IdentificationData:
    """Read a file of `write_mat`, one with `u`, `y` and `Ts`, or one with a matrix whose columns are signals.

    Parameters
    ----------
    path : path
        The file.
    variable : str, optional
        Name of the matrix, if the file contains more than one.
    inputs, outputs : sequence of int, optional
        Columns of the matrix, counted from 0.
    sample_time : float, optional
        Sample time (s), if the file does not contain it.

    Raises
    ------
    IdentificationError
        If the file cannot be read or does not contain the requested data.
    """
    path = Path(path)
    with reading("data", path):
        content = load_variables(path)
        if variable is None and inputs is None and outputs is None and {"u", "y"} <= set(content):
            return _signals(content, sample_time, str(path))
        matrix = only_matrix({name: value for name, value in content.items() if name != "Ts"}, variable)
        return data_of_matrix(matrix, inputs, outputs, sample_time, str(path))


def _signals(content: dict[str, Any], sample_time: float | None, source: str) -> IdentificationData:
    """Data of the variables u and y, and of the other variables of `write_mat` where present."""
    u, y = _matrices(content["u"]), _matrices(content["y"])
    if len(u) != len(y):
        raise IdentificationError(f"u has {len(u)} experiments, y has {len(y)}; the numbers must be equal")
    experiments = []
    for index, (inputs, outputs) in enumerate(zip(u, y, strict=True)):
        options: dict[str, Any] = {
            name: _matrices(content[matlab])[index] for name, matlab in _TRENDS.items() if matlab in content
        }
        reference = _matrices(content["r"])[index] if "r" in content else np.empty(0)
        experiments.append(
            Experiment(
                inputs,
                outputs,
                reference if reference.size else None,
                int(content["FirstStep"].ravel()[index]) if "FirstStep" in content else 0,
                texts(content["Source"])[index] if "Source" in content else source,
                **options,
            )
        )
    plain = IdentificationData.from_arrays(u[0], y[0], _sample_time(content, sample_time))
    labels: dict[str, Any] = {
        name: tuple(texts(content[matlab])) for name, matlab in _NAMES.items() if matlab in content
    }
    return replace(plain, experiments=tuple(experiments), **labels)


def _sample_time(content: dict[str, Any], given: float | None) -> float:
    """Sample time (s) of the file; a given one must agree with it."""
    if "Ts" not in content:
        return needed_sample_time(given)
    found = float(content["Ts"].item())
    if given is not None and abs(found - given) > 1e-9 * abs(found):
        raise IdentificationError(f"sample_time {given:g} s is given, but the file has Ts = {found:g} s")
    return found


def _matrices(value: NDArray[Any]) -> list[NDArray[np.float64]]:
    """The matrices of a cell, or the one matrix."""
    items = value.ravel().tolist() if value.dtype == object else [value]
    return [np.asarray(item, dtype=np.float64) for item in items]

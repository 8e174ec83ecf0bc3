"""Data from one matrix whose columns are signals, as in collections of benchmark data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.identification.data.dataset import IdentificationData


def only_matrix(content: Mapping[str, Any], variable: str | None) -> NDArray[np.float64]:
    """The named variable of a file, or the only numeric matrix in it.

    Raises
    ------
    IdentificationError
        If there is no matrix, none with this name, or several and no name is given.
    """
    matrices = {
        name: value
        for name, value in content.items()
        if isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiub" and min(value.shape) > 0
    }
    there = ", ".join(f"{name} {value.shape}" for name, value in matrices.items()) or "none"
    if variable is not None and variable not in matrices:
        raise IdentificationError(f"has no matrix {variable}; its matrices: {there}")
    if variable is None and len(matrices) != 1:
        raise IdentificationError(f"needs the name of one matrix as variable; its matrices: {there}")
    return np.asarray(matrices[variable or next(iter(matrices))], dtype=np.float64)


def data_of_matrix(
    matrix: NDArray[np.float64],
    inputs: Sequence[int] | None,
    outputs: Sequence[int] | None,
    sample_time: float | None,
    source: str,
) -> IdentificationData:
    """One experiment from the columns of a matrix, shape (steps, columns).

    Raises
    ------
    IdentificationError
        If columns or sample time are not given, or a column does not exist.
    """
    columns = matrix.shape[1]
    if inputs is None or outputs is None or not len(inputs) or not len(outputs):
        raise IdentificationError(
            f"which of the {columns} columns are inputs and which outputs is not known; "
            "give inputs and outputs, counted from 0"
        )
    for column in (*inputs, *outputs):
        if not 0 <= column < columns:
            raise IdentificationError(f"there is no column {column}; allowed: 0 to {columns - 1}")
    return IdentificationData.from_arrays(
        matrix[:, list(inputs)], matrix[:, list(outputs)], needed_sample_time(sample_time), source=source
    )


def needed_sample_time(sample_time: float | None) -> float:
    """The sample time (s); an error if it is not known."""
    if sample_time is None:
        raise IdentificationError("the sample time is not known; give sample_time in s")
    return sample_time

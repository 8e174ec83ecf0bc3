"""Variables in MATLAB and Octave files, version 5: numbers bit for bit, texts as cells of character arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.files.regular_files import open_regular


def cell(items: Sequence[Any]) -> NDArray[Any]:
    """A cell array with one row."""
    array = np.empty((1, len(items)), dtype=object)
    for index, item in enumerate(items):
        array[0, index] = item
    return array


def texts(value: NDArray[Any]) -> list[str]:
    """The texts of a cell, or the one text of a character array; an empty one comes back as an empty array."""
    items = value.ravel().tolist() if value.dtype == object else [value]
    return ["".join(np.asarray(item).ravel().tolist()) for item in items]


def save_variables(path: str | Path, variables: Mapping[str, Any]) -> None:
    """Write variables to a file; OSError if that fails."""
    from scipy import io

    with Path(path).open("wb") as file:
        io.savemat(file, dict(variables))


def load_variables(path: str | Path) -> dict[str, Any]:
    """Read the variables of a file; raises the errors of scipy if that fails.

    Raises
    ------
    IdentificationError
        If the file is of version 7.3, which is a different format.
    """
    from scipy import io

    try:
        with open_regular(path) as file:
            content = io.loadmat(file)
    except NotImplementedError:
        raise IdentificationError("is a MATLAB file of version 7.3; write it with save(..., '-v7')") from None
    return {name: value for name, value in content.items() if not name.startswith("__")}

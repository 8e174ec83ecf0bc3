"""Variables in MATLAB and Octave files: numbers bit for bit, texts as cells of character arrays.

Versions 5 to 7.2 are read and written by SciPy; version 7.3, which is HDF5, is read into the same form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.errors import IdentificationError
from amb_core.extras import extra
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
        If the file is of version 7.3 and cannot be read as HDF5.
    """
    from scipy import io

    try:
        with open_regular(path) as file:
            content = io.loadmat(file)
    except NotImplementedError:
        return _load_hdf5(path)
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _load_hdf5(path: str | Path) -> dict[str, Any]:
    with extra("files"):
        import h5py  # takes a while to import

    try:
        with open_regular(path) as file, h5py.File(file, "r") as content:
            return {name: _of_hdf5(content, item) for name, item in content.items() if not name.startswith("#")}
    except (OSError, RuntimeError, KeyError) as problem:
        raise IdentificationError(
            f"is a MATLAB file of version 7.3 that is damaged ({problem}); write it with save(..., '-v7')"
        ) from None


def _of_hdf5(file: Any, item: Any) -> Any:
    """A variable as `scipy.io.loadmat` returns it; a struct as a dictionary."""
    with extra("files"):
        import h5py

    if isinstance(item, h5py.Group):
        return {name: _of_hdf5(file, part) for name, part in item.items()}
    kind = item.attrs.get("MATLAB_class", b"")
    kind = kind.decode() if isinstance(kind, bytes) else str(kind)
    value = item[()]
    if item.attrs.get("MATLAB_empty", 0):
        return np.empty((0, 0))
    if kind == "char":
        return np.array(["".join(chr(code) for code in np.asarray(value).T.ravel().tolist())])
    if item.dtype.kind == "O":  # references: the items of a cell
        return cell([_of_hdf5(file, file[reference]) for reference in np.asarray(value).T.ravel().tolist()])
    return np.atleast_2d(np.asarray(value)).T if np.ndim(value) != 1 else np.asarray(value)[:, np.newaxis]

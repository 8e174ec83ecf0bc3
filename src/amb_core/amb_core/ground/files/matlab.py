"""Variables in MATLAB and Octave files: numbers bit for bit, texts as cells of character arrays.

Versions 5 to 7.2 are read and written by SciPy; version 7.3, which is HDF5, is read into the same form.
"""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError
from amb_core.ground.extras import extra
from amb_core.ground.files.apart import read_apart
from amb_core.ground.files.apart_server import seal
from amb_core.ground.files.limits import Items
from amb_core.ground.files.regular_files import open_regular


def cell(items: Sequence[Any]) -> NDArray[Any]:
    """A cell array with one row."""
    array = np.empty((1, len(items)), dtype=object)
    for index, item in enumerate(items):
        array[0, index] = item
    return array


def texts(value: NDArray[Any]) -> list[str]:
    """The texts of a cell or list, or the one text of a character array; an empty one comes back as an empty array."""
    items = value.ravel().tolist() if value.dtype == object or value.size > 1 else [value]
    return ["".join(np.asarray(item).ravel().tolist()) for item in items]


def save_variables(path: str | Path, variables: Mapping[str, Any]) -> None:
    """Write variables to a file; OSError if that fails."""
    from scipy import io

    with Path(path).open("wb") as file:
        io.savemat(file, dict(variables))


def load_variables(path: str | Path) -> dict[str, Any]:
    """Read the variables of a file; a struct is a dictionary. The file is read in a child process.

    Raises
    ------
    IdentificationError
        If the file is of version 7.3 and cannot be read as HDF5, or refers to other files.
    OSError, UnreadableError
        If it cannot be read, is damaged, or asks for more than `limits_for` allows.
    """
    variables: dict[str, Any] = read_apart(f"{__name__}:variables_of_file", path, modules=("scipy.io", "h5py"))
    return variables


def variables_of_file(path: str) -> dict[str, Any]:
    """As `load_variables`, in this process."""
    from scipy import io

    with open_regular(path) as file:
        seal()
        try:
            content = io.loadmat(file)
        except NotImplementedError:
            return _load_hdf5(file)
    items = Items()
    return {name: _plain(value, items, 0) for name, value in content.items() if not name.startswith("__")}


def _plain(value: Any, items: Items, depth: int) -> Any:
    """A variable without structured arrays, sparse matrices and objects, which stay out."""
    items.take(depth)
    if not isinstance(value, np.ndarray):
        return None
    if value.dtype.names and value.size == 1:
        return {field: _plain(value[field].ravel()[0], items, depth + 1) for field in value.dtype.names}
    if value.dtype.names:
        return {field: _plain(value[field], items, depth + 1) for field in value.dtype.names}
    if value.dtype == object:
        content = np.empty(value.size, dtype=object)
        for index, item in enumerate(value.ravel().tolist()):
            content[index] = _plain(item, items, depth + 1)
        return content.reshape(value.shape)
    return value if value.dtype.kind in "fiubcUS" else None


def _load_hdf5(stream: BinaryIO) -> dict[str, Any]:
    with extra("files"):
        import h5py  # takes a while to import

    try:
        with h5py.File(stream, "r") as content:
            reader = _Hdf5Reader(content)
            return {name: reader.member(content, name, 0) for name in content if not name.startswith("#")}
    except (OSError, RuntimeError, KeyError, ValueError, TypeError) as problem:
        if isinstance(problem, OSError) and problem.errno == errno.EFBIG:
            raise
        raise IdentificationError(
            f"is a MATLAB file of version 7.3 that is damaged ({problem}); write it with save(..., '-v7')"
        ) from None


class _Hdf5Reader:
    """Reads variables of version 7.3 as `load_variables` returns them; what several cells refer to is read once."""

    def __init__(self, file: Any) -> None:
        self._file, self._items = file, Items()
        self._known: dict[tuple[int, int], tuple[Any, int]] = {}  # by address and depth: the value, and its items

    def member(self, group: Any, name: str, depth: int) -> Any:
        """A variable or field by its name; one that is elsewhere, or a link to another name, is refused."""
        import h5py

        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise IdentificationError(
                f"{name!r} is a link, which MATLAB does not write; allowed: data in the file itself"
            )
        return self._value(group[name], depth)

    def _referred(self, reference: Any, depth: int) -> Any:
        """An item of a cell, counted as often as it is referred to."""
        import h5py

        item = self._file[reference]
        place = (h5py.h5o.get_info(item.id).addr, depth)
        if place in self._known:
            value, number = self._known[place]
            self._items.take(depth, number)
            return value
        before = self._items.taken
        value = self._value(item, depth)
        self._known[place] = (value, self._items.taken - before)
        return value

    def _value(self, item: Any, depth: int) -> Any:
        import h5py

        self._items.take(depth)
        if isinstance(item, h5py.Group):
            return {name: self.member(item, name, depth + 1) for name in item}
        if not isinstance(item, h5py.Dataset):
            return None
        if item.external or item.is_virtual:
            raise IdentificationError(f"{item.name!r} has its data in other files; allowed: data in the file itself")
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode() if isinstance(kind, bytes) else str(kind)
        if item.attrs.get("MATLAB_empty", 0):
            return np.empty((0, 0))
        value = item[()]
        if kind == "char":
            return np.array(["".join(chr(code) for code in np.asarray(value).T.ravel().tolist())])
        if item.dtype.kind == "O":  # references: the items of a cell
            references = np.asarray(value).T.ravel().tolist()
            return cell([self._referred(reference, depth + 1) for reference in references])
        return np.atleast_2d(np.asarray(value)).T if np.ndim(value) != 1 else np.asarray(value)[:, np.newaxis]

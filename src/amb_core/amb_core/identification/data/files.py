"""Data read from and written to files, by the ending of their names."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from amb_core.errors import IdentificationError
from amb_core.identification.data.bag_data import read_bag_data
from amb_core.identification.data.csv_files import read_csv, write_csv
from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.mat_files import read_mat, write_mat
from amb_core.identification.data.npz_files import read_npz, write_npz
from amb_core.regular_files import is_folder

_READERS: dict[str, Callable[..., IdentificationData]] = {".csv": read_csv, ".npz": read_npz, ".mat": read_mat}
_WRITERS: dict[str, Callable[[IdentificationData, Path], None]] = {
    ".csv": write_csv,
    ".npz": write_npz,
    ".mat": write_mat,
}


def read_data(path: str | Path, **options: Any) -> IdentificationData:
    """Read a `.csv`, `.npz` or `.mat` file, or anything else as a bag.

    Parameters
    ----------
    path : path
        The file or folder.
    **options
        Those of `read_csv`, `read_npz`, `read_mat` or `read_bag_data`.

    Raises
    ------
    IdentificationError
        If an option is not one of the kind of file, or the file cannot be read.
    BagError
        If it is neither such a file nor a bag, or the bag does not hold what is needed.
    """
    path = Path(path)
    reader = read_bag_data if is_folder(path) else _READERS.get(path.suffix.lower(), read_bag_data)
    allowed = list(inspect.signature(reader).parameters)[1:]
    if unknown := [name for name in options if name not in allowed]:
        raise IdentificationError(f"data {path}: option {unknown[0]} is not allowed; allowed: {', '.join(allowed)}")
    return reader(path, **options)


def write_data(data: IdentificationData, path: str | Path) -> None:
    """Write a `.csv`, `.npz` or `.mat` file, from which `read_data` reads the same data bit for bit.

    Raises
    ------
    IdentificationError
        If the ending is another, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in _WRITERS:
        raise IdentificationError(f"data {path}: the file name must end in {', '.join(_WRITERS)}")
    try:
        _WRITERS[path.suffix.lower()](data, path)
    except OSError as problem:
        raise IdentificationError(f"data {path}: cannot be written: {problem.strerror}") from None

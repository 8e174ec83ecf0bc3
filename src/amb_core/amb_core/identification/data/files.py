"""Data written to files, and the matching readers, by file name extension."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from amb_core.errors import IdentificationError
from amb_core.identification.data.csv_files import read_csv, write_csv
from amb_core.identification.data.dataset import IdentificationData
from amb_core.identification.data.mat_files import read_mat, write_mat
from amb_core.identification.data.npz_files import read_npz, write_npz

READERS: dict[str, Callable[..., IdentificationData]] = {".csv": read_csv, ".npz": read_npz, ".mat": read_mat}
_WRITERS: dict[str, Callable[[IdentificationData, Path], None]] = {
    ".csv": write_csv,
    ".npz": write_npz,
    ".mat": write_mat,
}


def write_data(data: IdentificationData, path: str | Path) -> None:
    """Write a `.csv`, `.npz` or `.mat` file, from which `amb_core.analysis.read_data` reads the same data bit for bit.

    Raises
    ------
    IdentificationError
        If the file name extension is not supported, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in _WRITERS:
        raise IdentificationError(f"data {path}: the file name must end in {', '.join(_WRITERS)}")
    try:
        _WRITERS[path.suffix.lower()](data, path)
    except OSError as problem:
        raise IdentificationError(f"data {path}: cannot be written: {problem.strerror}") from None

"""Data for identification from a recording or a file, by the ending of its name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from amb_core.analysis.recorded_data import read_bag_data
from amb_core.errors import IdentificationError
from amb_core.files.regular_files import is_folder
from amb_core.identification.data import READERS, IdentificationData


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
        If it is neither such a file nor a bag, or the bag does not contain the required data.
    """
    return data_reader(path, options)(path, **options)


def data_reader(path: str | Path, options: Iterable[str]) -> Callable[..., IdentificationData]:
    """The function that reads a file of this name; raises IdentificationError if it does not accept the options."""
    path = Path(path)
    reader = read_bag_data if is_folder(path) else READERS.get(path.suffix.lower(), read_bag_data)
    allowed = list(inspect.signature(reader).parameters)[1:]
    if unknown := [name for name in options if name not in allowed]:
        raise IdentificationError(f"data {path}: option {unknown[0]} is not allowed; allowed: {', '.join(allowed)}")
    return reader

"""Arrays of .npy and .npz files, read in a child process; pickled objects are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.files.apart import read_apart
from amb_core.ground.files.regular_files import open_regular


def load_arrays(path: str | Path) -> dict[str, NDArray[Any]]:
    """The arrays of an archive by name; a file with one array gives it the name of the file.

    Raises
    ------
    OSError, UnreadableError
        If it cannot be read, is damaged, or asks for more than `limits_for` allows.
    """
    arrays: dict[str, NDArray[Any]] = read_apart(f"{__name__}:arrays_of_file", path)
    return arrays


def arrays_of_file(path: str) -> dict[str, NDArray[Any]]:
    """As `load_arrays`, in this process."""
    with open_regular(path) as file:
        content = np.load(file, allow_pickle=False)
        return {Path(path).stem: content} if isinstance(content, np.ndarray) else dict(content)

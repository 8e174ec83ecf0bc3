"""Long columns in a MATLAB file of version 5, written part after part.

SciPy writes only arrays that are in memory as a whole. A file of version 5 is its header and one element after another,
so SciPy writes header and small variables, and the columns follow: elements of known length, filled place by place.
Source: MathWorks, "MAT-File Format", R2019b, chapter 1.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import BagError
from amb_core.ground.files.matlab import cell, save_variables

LONGEST = (1 << 31) // 8 - 1
"""Most rows: a variable of this version has at most 2 GiB."""
_MATRIX, _INT8, _INT32, _UINT32, _DOUBLE = 14, 1, 5, 6, 9  # data types
_DOUBLE_CLASS = 6
LONGEST_NAME = 63  # of a variable in MATLAB


def write_mat_columns(
    path: Path,
    names: Sequence[str],
    rows: int,
    batches: Iterable[Sequence[NDArray[np.float64]]],
    numbers: Mapping[str, float],
    texts: Mapping[str, Sequence[str]],
) -> None:
    """Write columns, each as a variable of shape (rows, 1).

    Parameters
    ----------
    path : Path
        The file.
    names : sequence of str
        Names of the columns.
    rows : int
        Length of every column.
    batches : iterable of sequence of ndarray
        Consecutive parts: for each column its next values, shape (n,).
    numbers : mapping of str to float
        Further variables.
    texts : mapping of str to sequence of str
        Further variables that are cells of texts.

    Raises
    ------
    BagError
        If there are more rows than a variable can have, or a name is not allowed in MATLAB or there twice.
    OSError
        If the file cannot be written.
    """
    if rows > LONGEST:
        raise BagError(f"{rows} samples are too many for a MATLAB file (allowed: {LONGEST}); use --from and --to")
    for name in names:
        if not name.isascii() or not name.isidentifier() or name.startswith("_") or len(name) > LONGEST_NAME:
            raise BagError(f"column {name!r} cannot be a variable in MATLAB; export as .csv or .parquet")
        if name in numbers or name in texts:
            raise BagError(f"column {name!r} has the name of another variable of the file; export as .csv or .parquet")
    save_variables(path, {**numbers, **{name: cell(values) for name, values in texts.items()}})
    with path.open("r+b") as file:
        places = []
        file.seek(0, 2)
        for name in names:
            head = _head(name, rows)
            places.append(file.tell() + len(head))
            file.write(head)
            file.seek(8 * rows, 1)
        file.truncate(file.tell())
        done = 0
        for batch in batches:
            for place, values in zip(places, batch, strict=True):
                file.seek(place + 8 * done)
                file.write(values.astype("<f8", copy=False).tobytes())
            done += len(batch[0])
    if done != rows:
        raise BagError(f"{rows} rows were announced, {done} came")


def _head(name: str, rows: int) -> bytes:
    """The bytes of a column before its first value."""
    text = name.encode()
    inner = (
        struct.pack("<IIII", _UINT32, 8, _DOUBLE_CLASS, 0)
        + struct.pack("<IIii", _INT32, 8, rows, 1)
        + struct.pack("<II", _INT8, len(text))
        + text.ljust(-(-len(text) // 8) * 8, b"\0")
        + struct.pack("<II", _DOUBLE, 8 * rows)
    )
    return struct.pack("<II", _MATRIX, len(inner) + 8 * rows) + inner

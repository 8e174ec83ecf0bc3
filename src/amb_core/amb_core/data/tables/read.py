"""Reads a file of numbers, by the ending of its name, as its content and as a table."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from amb_core.data.tables.matrices import table_of_variables
from amb_core.data.tables.parquet import read_parquet_table
from amb_core.data.tables.table import Table
from amb_core.data.tables.text import read_text_table
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.arrays import load_arrays
from amb_core.ground.files.matlab import load_variables

TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc")
ENDINGS = (*TEXTS, ".mat", ".npz", ".npy", ".parquet", ".pq")
"""Endings of the names of files that are read as tables; anything else is read as a bag."""

Content = Table | Mapping[str, Any]
"""A text or Parquet file as a table; the variables of a MATLAB or NumPy file by name."""


def load_content(path: Path, separator: str = "", decimal: str = "") -> Content:
    """Read a file whose name ends in one of `ENDINGS`, once.

    Parameters
    ----------
    path : Path
        The file.
    separator, decimal : str, optional
        Of a text: `comma`, `semicolon`, `tab`, `bar` or `space`; `point` or `comma`. By default as they are found.

    Returns
    -------
    Content
        The table of a text, or the variables of another file.

    Raises
    ------
    IdentificationError, OSError, UnreadableError
        If the file cannot be read; the message names the option that helps.
    """
    ending = path.suffix.lower()
    if ending in TEXTS:
        return read_text_table(path, separator, decimal)
    if ending == ".mat":
        return load_variables(path)
    if ending in (".npz", ".npy"):
        return load_arrays(path)
    if ending in (".parquet", ".pq"):
        return read_parquet_table(path)
    raise IdentificationError(f"the file name must end in {', '.join(ENDINGS)}")


def table_of(path: Path, content: Content, variable: str = "") -> Table:
    """The content of a file as a table.

    Parameters
    ----------
    path : Path
        The file, for messages.
    content : Content
        From `load_content`.
    variable : str, optional
        Matrix or struct of a .mat or .npz file; empty for the only one.

    Returns
    -------
    Table
        Columns of one length.

    Raises
    ------
    IdentificationError
        If it holds no table; the message names the option that helps.
    """
    return content if isinstance(content, Table) else table_of_variables(str(path), content, variable)

"""Reads a file of numbers, by the ending of its name, as its content and as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from amb_core.data.tables.cells import experiments_of
from amb_core.data.tables.matrices import flat, table_of_variables
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


def tables_of(path: Path, content: Content, variable: str = "", columns: Sequence[str] = ()) -> list[Table]:
    """The content of a file as tables.

    Parameters
    ----------
    path : Path
        The file, for messages.
    content : Content
        From `load_content`.
    variable : str, optional
        Matrix or struct of a .mat or .npz file; empty for the only one.
    columns : sequence of str, optional
        Columns that are asked for.

    Returns
    -------
    list of Table
        One for each experiment of cells, otherwise a single one; columns of one length.

    Raises
    ------
    IdentificationError
        If it holds no table; the message names the option that helps.
    """
    if isinstance(content, Table):
        return [content]
    experiments = experiments_of(dict(flat(content)), columns)
    if len(experiments) == 1:
        return [table_of_variables(str(path), experiments[0], variable, columns)]
    return [table_of_variables(f"experiment {k}", each, variable, columns) for k, each in enumerate(experiments)]

"""Reads a file of numbers as a table, by the ending of its name."""

from __future__ import annotations

from pathlib import Path

from amb_core.errors import IdentificationError
from amb_core.files.arrays import load_arrays
from amb_core.files.file_errors import reading
from amb_core.files.matlab import load_variables
from amb_core.tables.matrices import table_of_variables
from amb_core.tables.parquet import read_parquet_table
from amb_core.tables.table import Table
from amb_core.tables.text import read_text_table

TEXTS = (".csv", ".txt", ".tsv", ".dat", ".asc")
ENDINGS = (*TEXTS, ".mat", ".npz", ".npy", ".parquet", ".pq")
"""Endings of the names of files that are read as tables; anything else is read as a bag."""


def read_table(path: str | Path, variable: str = "", separator: str = "", decimal: str = "") -> Table:
    """Read a file whose name ends in one of `ENDINGS`.

    Parameters
    ----------
    path : path
        The file.
    variable : str, optional
        Matrix or struct of a .mat or .npz file.
    separator, decimal : str, optional
        Of a text: `comma`, `semicolon`, `tab`, `bar` or `space`; `point` or `comma`. By default as they are found.

    Raises
    ------
    IdentificationError
        If the file cannot be read or holds no table; the message names the option that helps.
    """
    path = Path(path)
    ending = path.suffix.lower()
    with reading("data", path):
        if ending in TEXTS:
            return read_text_table(path, separator, decimal)
        if ending == ".mat":
            return table_of_variables(str(path), load_variables(path), variable)
        if ending in (".npz", ".npy"):
            return table_of_variables(str(path), load_arrays(path), variable)
        if ending in (".parquet", ".pq"):
            return read_parquet_table(path)
        raise IdentificationError(f"the file name must end in {', '.join(ENDINGS)}")

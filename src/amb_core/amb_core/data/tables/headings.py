"""Names and units of the columns of a text, from the rows above its numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from amb_core.data.tables.table import split_unit
from amb_core.data.tables.units import is_known
from amb_core.ground.errors import IdentificationError


def headings_of(rows: Sequence[Sequence[str]], count: int) -> tuple[list[tuple[str, str]], bool]:
    """Name and unit of each column, and whether the names are one fewer than the columns.

    The last row may hold units only. A row of one cell less stands above all columns but the first: so tables are
    written whose first column has names of the rows, as by `write.table` of R.
    """
    rows = [row for row in rows if len(row) == count or (len(row) == count - 1 and len(row) > 1)]
    if not rows:
        return [], False
    with_units = len(rows) > 1 and _are_units(rows[-1])
    fewer = any(len(row) < count for row in rows[-1 - with_units :])
    names, *units = ([*[""] * (count - len(row)), *row] for row in rows[-1 - with_units :])
    if not units:
        return [split_unit(name) for name in names], fewer
    bare = [unit if (unit := _bare(cell)) != "-" else "" for cell in units[0]]
    return [(split_unit(name)[0], unit) for name, unit in zip(names, bare, strict=True)], fewer


def counts_columns(row: Sequence[str]) -> bool:
    """Whether a row counts the columns from 0 or 1, as a heading of a program does that has no names for them.

    The first cell is empty where that column has names of the rows.
    """
    named = row[1:] if not row[0] else row
    return len(row) > 1 and list(named) in [[str(first + place) for place in range(len(named))] for first in (0, 1)]


def are_fractions(rows: Sequence[Sequence[str]], columns: range) -> bool:
    """Whether in each of some columns fewer than half of the cells are whole numbers."""
    whole = re.compile(r"[+-]?\d+")
    return bool(rows) and all(2 * sum(bool(whole.fullmatch(row[k])) for row in rows) < len(rows) for k in columns)


def without_row_names(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """The columns but the first, which has no name: its cells are texts, or count the rows from 0 or 1.

    Raises
    ------
    IdentificationError
        If it has other numbers, so that any of the columns may be the one without a name.
    """
    first, count = numbers[:, 0], numbers.shape[1]
    if not np.isnan(first).all() and not any(np.array_equal(first, start + np.arange(len(first))) for start in (0, 1)):
        raise IdentificationError(
            f"{count - 1} names stand above {count} columns, and the first column neither counts the rows nor is a "
            "text: which column has no name is not known; write a name above every column"
        )
    return numbers[:, 1:]


def _are_units(row: Sequence[str]) -> bool:
    cells = [_bare(cell) for cell in row]
    return any(cells) and all(not cell or cell == "-" or is_known(cell) for cell in cells)


def _bare(cell: str) -> str:
    return cell.strip().strip("[]()").strip()

"""A table: columns of numbers of one length, with the names and units that their file gives them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import IdentificationError

_PARTS = (
    re.compile(r"^(?P<name>.+?)\s*\[(?P<unit>(?!(?:\d+|[xyz]\w*)\])[^\]]*)\]$"),  # but position[x] is the axis x
    re.compile(r"^(?P<name>.+?)\s*\((?P<unit>[^)]*)\)$"),
    re.compile(r"^(?P<name>.+?)\s+/\s*(?P<unit>\S+)$"),
)
# Only units that are no word of their own: `coil_A` is a coil, `x_min` a minimum.
_SUFFIX = re.compile(r"^(?P<name>.+)_(?P<unit>[munµμ]m|[muµμ]A|[munµμ]s|mil)$")


@dataclass(frozen=True, eq=False)
class Column:
    """A signal of a table.

    Attributes
    ----------
    name : str
        Name as the file has it, without the unit.
    values : ndarray, shape (rows,)
        The numbers, in the unit of the file; NaN where one is missing.
    unit : str
        As the file has it; empty where it has none.
    source : str
        Variable or topic that the column is part of, empty for a table that is one matrix or text.
    named : bool
        Whether the file names the column; False if its name is only its place.
    heading : str
        Its name in the file, where a description gives it another; otherwise empty.
    """

    name: str
    values: NDArray[np.float64]
    unit: str = ""
    source: str = ""
    named: bool = True
    heading: str = ""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of one length.

    Attributes
    ----------
    path : str
        Where it comes from, for messages.
    columns : tuple of Column
        At least one.
    sample_time : float or None
        Sample time (s), if the file has it beside the columns. None otherwise.
    notes : tuple of str
        What was understood that is not plain from the columns.
    about : mapping or None
        What a text of `write_data` has beside the columns; None for another one.
    clearance : mapping of str to float
        Clearances (m) that the file has beside the columns, by the name of the column of the position.
    left_out : str
        Variables that are no columns since their length is another one, with their shapes.
    """

    path: str
    columns: tuple[Column, ...]
    sample_time: float | None = None
    notes: tuple[str, ...] = ()
    about: Mapping[str, Any] | None = None
    left_out: str = ""
    clearance: Mapping[str, float] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.columns[0].values)

    @property
    def names(self) -> str:
        """All names, for messages."""
        names = [column.name for column in self.columns]
        shown = ", ".join(names[:40])
        shown = shown if len(names) <= 40 else f"{shown} and {len(names) - 40} more"
        return f"{shown} (left out, of another length: {self.left_out})" if self.left_out else shown

    def find(self, wanted: str, option: str) -> list[Column]:
        """The columns that a name of a user means: a name, the end of one, a variable, or numbers from 0 as 0-3.

        A number that is also the name of another column, or its end, is refused; 1-1 is always the number.

        Parameters
        ----------
        wanted : str
            What the user wrote.
        option : str
            Option of the command that it was written for, for messages.

        Returns
        -------
        list of Column
            At least one column.

        Raises
        ------
        IdentificationError
            If there is none, or more than one.
        """
        for match in (_exact, _without_case, _ending, _variable):
            matches = match(self.columns, wanted)
            if len(matches) == 1 or (matches and match is _variable):
                self._refuse_other_number(matches, wanted, option)
                return matches
            if matches:
                names = ", ".join(column.name for column in matches)
                raise IdentificationError(f"--{option} {wanted} may be {names}; write more of its name")
        numbers = re.fullmatch(r"(\d+)(?:-(\d+))?", wanted)
        if not numbers:
            raise IdentificationError(f"--{option}: there must be one column {wanted!r}; there are {self.names}")
        if len({column.source for column in self.columns}) > 1:
            raise IdentificationError(
                f"--{option} {wanted} is a number, but there are several matrices; name one with --variable: "
                + ", ".join(dict.fromkeys(column.source for column in self.columns))
            )
        first, last = int(numbers[1]), int(numbers[2] or numbers[1])
        if last >= len(self.columns) or first > last:
            raise IdentificationError(
                f"--{option}: there is no column {max(first, last)}; allowed: 0 to {len(self.columns) - 1}"
            )
        return list(self.columns[first : last + 1])

    def _refuse_other_number(self, named: list[Column], wanted: str, option: str) -> None:
        """Refuse a name that is also the number of a column that it does not name."""
        several = len({column.source for column in self.columns}) > 1  # where numbers are not allowed
        if several or not re.fullmatch(r"\d+", wanted) or int(wanted) >= len(self.columns):
            return
        numbered, place = self.columns[int(wanted)], self.columns.index(named[0])
        if named != [numbered]:
            raise IdentificationError(
                f"--{option} {wanted} may be column {wanted} ({numbered.name}) or column {place} ({named[0].name}), "
                f"counted from 0; write {wanted}-{wanted} or {place}-{place}"
            )


def split_unit(text: str) -> tuple[str, str]:
    """Name and unit of a heading such as `i_x [A]`, `Time (s)`, `x / um` or `time_ms`; no unit is an empty one.

    A name keeps the unit that it ends in: `time_ms` is the name of that column.
    """
    text = text.strip().strip('"').strip()
    for pattern in _PARTS:
        if heading := pattern.match(text):
            return heading["name"].strip(), heading["unit"].strip()
    suffix = _SUFFIX.match(text)
    return text, suffix["unit"] if suffix else ""


def without_suffix(name: str) -> str:
    """A name without the unit that it ends in: `time` for `time_ms`."""
    suffix = _SUFFIX.match(name)
    return suffix["name"] if suffix else name


def ends_in(name: str, wanted: str) -> bool:
    """Whether a column's name is the wanted one, or ends in it at a boundary of its parts; without case.

    `/rig.position[x]` ends in `position[x]`.
    """
    name, end = name.casefold(), wanted.casefold()
    return name == end or (bool(end) and name.endswith(end) and name[-len(end) - 1] in "./ ")


def _exact(columns: tuple[Column, ...], wanted: str) -> list[Column]:
    return [column for column in columns if column.name == wanted]


def _without_case(columns: tuple[Column, ...], wanted: str) -> list[Column]:
    return [column for column in columns if column.name.casefold() == wanted.casefold()]


def _ending(columns: tuple[Column, ...], wanted: str) -> list[Column]:
    return [column for column in columns if ends_in(column.name, wanted)]


def _variable(columns: tuple[Column, ...], wanted: str) -> list[Column]:
    return [column for column in columns if column.source == wanted]

"""Which columns of a table are inputs, outputs, reference and times: as named, or where the names leave no doubt."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from amb_core.data.experiments.description import DataDescription, column_of
from amb_core.data.experiments.proposal import UndescribedError, proposed
from amb_core.data.tables import Column, Table
from amb_core.data.tables.table import without_suffix
from amb_core.data.tables.units import TIMES, spelled
from amb_core.ground.errors import IdentificationError

_TIMES = {
    "time", "t", "zeit", "temps", "tiempo", "tempo", "tijd", "timestamp", "stamp", "sec", "seconds", "time_s", "t_s",
    "czas", "aika", "tid", "vremya", "время", "时间", "時間",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Roles:
    """Columns by role; `time` is None where there are no times."""

    inputs: list[Column]
    outputs: list[Column]
    reference: list[Column]
    time: Column | None


def find_roles(table: Table, description: DataDescription) -> Roles:
    """The roles of the columns of a table.

    Raises
    ------
    IdentificationError
        If a named column does not exist.
    UndescribedError
        If which ones are inputs and outputs is not known.
    """
    time = _time(table, description)
    inputs, outputs, reference = (
        [column for item in getattr(description, option) for column in _named(table, item, option)]
        for option in ("inputs", "outputs", "reference")
    )
    others = [column for column in table.columns if column is not time]
    if not inputs and not outputs:
        inputs, outputs, reference_found = _by_name(others)
        reference = reference or reference_found
    if not inputs or not outputs:
        missing = " and ".join(
            f"--{name}" for name, columns in (("inputs", inputs), ("outputs", outputs)) if not columns
        )
        proposal = proposed(others)
        raise UndescribedError(
            f"which of the {len(table.columns)} columns are inputs and which outputs is not known; give inputs and "
            f"outputs ({missing}, names or numbers from 0); there are {table.names}{_choice_of_struct(table)}"
            + ("" if proposal is None else f"; perhaps {proposal.options}"),
            None if proposal is None else description.with_values(**proposal.given),
        )
    if reference and len(reference) != len(outputs):
        raise IdentificationError(f"--reference has {len(reference)} columns, --outputs {len(outputs)}; one for each")
    if time is not None and any(column.values is time.values for column in (*inputs, *outputs, *reference)):
        raise IdentificationError(f"column {time.name} is named as time and as signal; give --time")
    for column in (*inputs, *outputs):
        if sum(column.values is other.values for other in (*inputs, *outputs)) > 1:
            raise IdentificationError(f"column {column.name} is named more than once in --inputs and --outputs")
    for column in reference:
        if any(column.values is other.values for other in (*inputs, *outputs)):
            raise IdentificationError(f"column {column.name} is named in --reference, and in --inputs or --outputs")
    return Roles(inputs, outputs, reference, time)


def _named(table: Table, item: str, option: str) -> list[Column]:
    """The columns that an item such as x or i_x=cur_x_A means, with the name that it gives."""
    name, wanted = column_of(item)
    if not name or any(column.name == item for column in table.columns):
        return table.find(item, option)
    matches = table.find(wanted, option)
    if len(matches) != 1:
        raise IdentificationError(f"--{option} {item} means {len(matches)} columns; name one")
    return [replace(matches[0], name=name, named=True, heading=matches[0].name)]


def _time(table: Table, description: DataDescription) -> Column | None:
    if description.time == "none":
        return None
    if description.time:
        matches = table.find(description.time, "time")
        if len(matches) != 1:
            raise IdentificationError(f"--time {description.time} means {len(matches)} columns; name one")
        return matches[0]
    named = [column for column in table.columns if column.named and _last(column.name) in _TIMES]
    if not named:
        named = [column for column in table.columns if column.named and spelled(column.unit) in TIMES]
    if len(named) > 1:
        raise IdentificationError(f"columns {', '.join(c.name for c in named)} may all be times; name one with --time")
    return named[0] if named else None


def _by_name(columns: Sequence[Column]) -> tuple[list[Column], list[Column], list[Column]]:
    """Columns named i_x, x and r_x, for each axis, or u1, y1; none where a name is missing.

    Those of several structs may be several experiments: none is theirs.
    """
    names = Counter(without_suffix(column.name) for column in columns)
    by_name = {name: c for c in columns if c.named and names[name := without_suffix(c.name)] == 1}
    axes = [name.removeprefix("i_") for name in by_name if name.startswith("i_") and name.removeprefix("i_") in by_name]
    if axes:
        reference = [by_name[f"r_{axis}"] for axis in axes if f"r_{axis}" in by_name]
        inputs, outputs = [by_name[f"i_{axis}"] for axis in axes], [by_name[axis] for axis in axes]
        return inputs, outputs, reference if len(reference) == len(axes) else []
    roles = {
        letter: [
            c
            for c in columns
            if re.fullmatch(rf"{letter}(?:_?\d+|\[\d+\])?", without_suffix(c.name)) or _last(c.source) == letter
        ]
        for letter in "uyr"
    }
    structs = {_struct(column) for of_role in roles.values() for column in of_role}
    if roles["u"] and roles["y"] and len(structs) == 1:
        return roles["u"], roles["y"], roles["r"] if len(roles["r"]) == len(roles["y"]) else []
    return [], [], []


def _struct(column: Column) -> str:
    """The struct that a column is a field of; empty for none."""
    return column.source.rpartition(".")[0]


def _choice_of_struct(table: Table) -> str:
    """What to add to a question where the columns are fields of several structs."""
    structs = [name for name in dict.fromkeys(map(_struct, table.columns)) if name]
    return f"; name one struct with --variable: {', '.join(structs)}" if len(structs) > 1 else ""


def _last(name: str) -> str:
    return without_suffix(name.casefold().rsplit(".", 1)[-1].strip())

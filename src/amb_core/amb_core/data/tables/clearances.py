"""The clearances of a machine as fields of a file: a number for each axis, and their unit, which is m in our own files.

Tables name the axis in the field, as `clearance_x`. Files of data have one row of numbers, NaN where one is not known.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from amb_core.data.tables.units import LENGTHS, spelled
from amb_core.ground.errors import IdentificationError

ROW, UNIT = "clearance", "clearance_unit"
_OF_AXIS = f"{ROW}_"


def clearance_fields(clearance: Mapping[str, float]) -> dict[str, float | str]:
    """Fields of a table for clearances (m) by axis; none without any."""
    fields: dict[str, float | str] = {f"{_OF_AXIS}{axis}": value for axis, value in clearance.items()}
    return fields | {UNIT: "m"} if fields else {}


def clearances_in(fields: Mapping[str, Any]) -> dict[str, float]:
    """Clearances (m) by axis in the fields of a table; none where they lack a unit of length."""
    unit = _text(fields.get(UNIT, ""))
    named = {
        name.removeprefix(_OF_AXIS): value
        for name, value in fields.items()
        if name.startswith(_OF_AXIS) and name != UNIT and np.size(value) == 1
    }
    values = [_number(value) for value in named.values()]
    return clearances_of(list(named), values, unit) if spelled(unit) in LENGTHS else {}


def clearance_row(names: Sequence[str], clearance: Mapping[str, float]) -> dict[str, Any]:
    """The row for a file of data, and its unit; nothing where no clearance (m) is known."""
    return {ROW: [clearance.get(name, math.nan) for name in names], UNIT: "m"} if clearance else {}


def clearances_of_row(names: Sequence[str], fields: Mapping[str, Any]) -> dict[str, float]:
    """Clearances (m) by name in a file of data; none in a file without them, as those of version 0.1.

    Raises
    ------
    IdentificationError
        If there is not one for each name, or their unit is none of length.
    """
    return clearances_of(names, fields[ROW], _text(fields.get(UNIT, ""))) if ROW in fields else {}


def clearances_of(names: Sequence[str], values: ArrayLike, unit: str) -> dict[str, float]:
    """Clearances (m) by name from values in a unit; one that is no positive number is not known.

    Raises
    ------
    IdentificationError
        If there is not one for each name, or the unit is none of length.
    """
    row = np.asarray(values, dtype=np.float64).ravel().tolist()
    if len(row) != len(names) or spelled(unit) not in LENGTHS:
        raise IdentificationError(
            f"has {len(row)} clearances in {unit or 'no unit'}; allowed: one for each of {', '.join(names)}, in "
            f"{', '.join(LENGTHS)}"
        )
    factor = LENGTHS[spelled(unit)]
    return {name: factor * value for name, value in zip(names, row, strict=True) if 0.0 < value < math.inf}


def _text(value: Any) -> str:
    """A text of a field, also as the array or cell that a MATLAB or NumPy file makes of it."""
    item = np.asarray(value).ravel()
    return _text(item[0]) if item.size and isinstance(item[0], np.ndarray) else str(item[0]) if item.size else ""


def _number(value: Any) -> float:
    """A number, or NaN for anything else."""
    try:
        return float(np.asarray(value).ravel()[0])
    except (TypeError, ValueError):
        return math.nan

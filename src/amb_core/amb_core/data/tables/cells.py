"""Cells of a MATLAB file with one matrix for each experiment, as its iddata have them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from amb_core.ground.errors import IdentificationError


def experiments_of(variables: Mapping[str, Any], wanted: Sequence[str] = ()) -> list[Mapping[str, Any]]:
    """The variables of each experiment: of cells their item, all others as they are.

    Parameters
    ----------
    variables : mapping
        Variables by name, a field of a struct as `struct.field`.
    wanted : sequence of str, optional
        Names that a user gives to signals.

    Returns
    -------
    list of mapping
        One mapping, unless `u` and `y` or the wanted signals are cells.

    Raises
    ------
    IdentificationError
        If these have different numbers of experiments.
    """
    cells = {name: value for name, value in variables.items() if _is_of_numbers(value)}
    asked = {"u", "y", *(column.partition("[")[0] for column in wanted)}
    signals = {name: value.size for name, value in cells.items() if {name, name.rpartition(".")[2]} & asked}
    if not signals:
        return [variables]
    if len(set(signals.values())) > 1:
        sizes = ", ".join(f"{name} has {size} experiments" for name, size in signals.items())
        raise IdentificationError(f"{sizes}; the numbers must be equal")
    number = next(iter(signals.values()))
    items = {name: value.ravel() for name, value in cells.items() if value.size == number}
    others = {name: value for name, value in variables.items() if name not in cells}
    return [others | {name: value[index] for name, value in items.items()} for index in range(number)]


def _is_of_numbers(value: Any) -> bool:
    return (
        isinstance(value, np.ndarray)
        and value.dtype == object
        and value.size > 0
        and all(isinstance(item, np.ndarray) and item.dtype.kind in "fiub" for item in value.ravel())
    )

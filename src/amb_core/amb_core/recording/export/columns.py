"""Columns of an exported run: one row per step, named with units as `amb identify FILE` understands them."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from amb_core.ground.errors import BagError
from amb_core.loop.records import LoopRecord

SIGNALS = {"reference": ("r_{}", "m"), "position": ("{}", "m"), "current": ("i_{}", "A")}
"""Signals of telemetry, each with the name of its column for an axis, and its unit."""


@dataclass(frozen=True)
class ColumnName:
    """Name and unit of a column."""

    name: str
    unit: str

    @property
    def heading(self) -> str:
        """As `i_x [A]`."""
        return f"{self.name} [{self.unit}]"


def column_names(axes: Collection[str], signals: Collection[str] = ()) -> list[ColumnName]:
    """The columns: time, and the wanted signals (by default all) of each axis, axis after axis."""
    chosen = chosen_signals(signals)
    columns = [ColumnName("time", "s")]
    columns += [ColumnName(SIGNALS[name][0].format(axis), SIGNALS[name][1]) for axis in axes for name in chosen]
    if len({column.name for column in columns}) < len(columns):
        raise BagError(
            f"axes {', '.join(axes)}: two columns would have one name; names such as time, r_x and i_x are not allowed "
            "beside x"
        )
    return columns


def chosen_signals(signals: Collection[str], others: Collection[str] = ()) -> list[str]:
    """The wanted signals in their order, all without a choice; BagError if there is no such signal.

    `others` are names that stand for something else.
    """
    allowed = [*SIGNALS, *others]
    for name in signals:
        if name not in allowed:
            raise BagError(f"--topics {name}: there is no such topic in this format; allowed: {', '.join(allowed)}")
    return [name for name in allowed if not signals or name in signals]


def column_values(record: LoopRecord, signals: Collection[str] = ()) -> Iterator[NDArray[np.float64]]:
    """The values of the columns of `column_names`, in their order, each of shape (steps,)."""
    chosen = chosen_signals(signals)
    yield record.time
    for index in range(len(record.axes)):
        for name in chosen:
            yield np.ascontiguousarray(getattr(record, name)[:, index])

"""Records from which distortion and coherence can be measured."""

from __future__ import annotations

from collections.abc import Sequence

from amb_core.ground.errors import SpectrumError
from amb_core.loop.records import LoopRecord


def axes_of(records: Sequence[LoopRecord]) -> tuple[str, ...]:
    """The axes of the machine that all records are of.

    Raises
    ------
    SpectrumError
        If a record has other axes than the first one.
    """
    axes = tuple(records[0].axes)
    for record in records:
        if tuple(record.axes) != axes:
            raise SpectrumError(
                f"the records are of different machines: axes {', '.join(axes)} and {', '.join(record.axes)}"
            )
    return axes

"""Records from which distortion and coherence can be measured."""

from __future__ import annotations

from collections.abc import Sequence

from amb_core.errors import SpectrumError
from amb_core.loop.records import LoopRecord


def require_one_bearing(records: Sequence[LoopRecord]) -> None:
    """Refuse records of other machines than one bearing.

    Raises
    ------
    SpectrumError
        If a record has more or fewer axes than two.
    """
    for record in records:
        if len(record.axes) != 2:
            raise SpectrumError(
                f"the record has the axes {', '.join(record.axes)}; distortion and coherence are measured on one "
                "bearing with two axes"
            )

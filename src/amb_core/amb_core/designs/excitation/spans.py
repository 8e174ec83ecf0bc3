"""Spans in which a signal excites the axes of one bearing: regions, limits and designs are those of a single one."""

from __future__ import annotations

from amb_core.excitation import ExcitationSignal
from amb_core.excitation.signal import excited_spans
from amb_core.ground.errors import ExcitationError


def spans_on_one_bearing(signal: ExcitationSignal) -> list[tuple[int, int, int]]:
    """Excited axis (0 for x, 1 for y), first and stop step of each span.

    Raises
    ------
    ExcitationError
        If the signal is made for another machine than one bearing with x and y.
    """
    if len(signal.machine.axes) != 2:
        raise ExcitationError(
            f"{signal.kind}: the signal is for the axes {', '.join(signal.machine.axis_names)}; a check or design on a "
            "region map is for one bearing with axes x, y"
        )
    return excited_spans(signal)

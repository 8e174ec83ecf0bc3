"""Spans in which a signal excites the axes of one bearing: regions, limits and designs are those of a single one."""

from __future__ import annotations

from amb_core.excitation import ExcitationSignal
from amb_core.excitation.signal import excited_spans
from amb_core.ground.errors import ExcitationError
from amb_core.loop.machine import Machine


def spans_on_one_bearing(signal: ExcitationSignal) -> list[tuple[int, int, int]]:
    """Excited axis (0 for x, 1 for y), first and stop step of each span.

    Raises
    ------
    ExcitationError
        If the signal is made for another machine than one bearing with x and y.
    """
    require_one_bearing(signal.machine, f"{signal.kind}: the signal is for")
    return excited_spans(signal)


def require_one_bearing(machine: Machine, subject: str) -> None:
    """Refuse another machine than one bearing with x and y; the message begins with the subject.

    Raises
    ------
    ExcitationError
        If the machine has other axes.
    """
    if len(machine.axes) != 2:
        raise ExcitationError(
            f"{subject} the axes {', '.join(machine.axis_names)}; a check or design on a region map is for one bearing "
            "with axes x, y"
        )

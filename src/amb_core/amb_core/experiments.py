"""Experiments: which steps of a run an excitation was applied to, as the controller confirmed them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol


class ExcitationStatus(Protocol):
    """The controller's answer to an excitation, received over ROS or decoded from a bag (amb_msgs/ExcitationStatus)."""

    run: int
    id: int
    kind: str
    accepted: bool
    message: str
    first_step: int
    steps: int


@dataclass(frozen=True)
class AppliedExcitation:
    """An excitation and the controller's answer to it.

    Attributes
    ----------
    run, id : int
        Run it was meant for; its number among the excitations of its generator.
    kind : str
        Kind of excitation; `stop` for one that ends another.
    accepted : bool
        Whether the controller applied it; if not, `message` is the reason.
    first_step, steps : int
        Steps to which it was applied; `steps` is 0 for a stop.
    """

    run: int
    id: int
    kind: str
    accepted: bool
    message: str
    first_step: int
    steps: int

    @property
    def stop(self) -> int:
        """Step after its last one."""
        return self.first_step + self.steps


def excitation_from_message(message: ExcitationStatus) -> AppliedExcitation:
    """The excitation of an ExcitationStatus message."""
    return AppliedExcitation(
        run=int(message.run),
        id=int(message.id),
        kind=str(message.kind),
        accepted=bool(message.accepted),
        message=str(message.message),
        first_step=int(message.first_step),
        steps=int(message.steps),
    )


def last_experiment(excitations: Iterable[AppliedExcitation], run: int) -> tuple[int, int] | None:
    """First step of the last excitation of a run and the step after its last one; None when nothing was excited.

    An excitation ends early where a stop took effect.
    """
    window = None
    for excitation in excitations:
        if excitation.run != run or not excitation.accepted:
            continue
        if excitation.steps:
            window = (excitation.first_step, excitation.stop)
        elif window is not None:
            window = (window[0], max(window[0], min(window[1], excitation.first_step)))
    return window

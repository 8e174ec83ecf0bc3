"""amb_msgs/ExcitationStatus: the controller's answer to an excitation."""

from __future__ import annotations

from typing import Any

from amb_core.loop.experiments import AppliedExcitation

EXCITATION_STATUS = "amb_msgs/msg/ExcitationStatus"


def answer_from_message(message: Any) -> AppliedExcitation:
    """The excitation that an ExcitationStatus message answers, and the answer."""
    return AppliedExcitation(
        run=int(message.run),
        id=int(message.id),
        kind=str(message.kind),
        accepted=bool(message.accepted),
        message=str(message.message),
        first_step=int(message.first_step),
        steps=int(message.steps),
    )

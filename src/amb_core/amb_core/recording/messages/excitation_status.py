"""amb_msgs/ExcitationStatus: the controller's answer to an excitation."""

from __future__ import annotations

from typing import Any

from amb_core.ground.errors import bounded
from amb_core.loop.experiments import AppliedExcitation

LONGEST_KIND = 50  # characters
EXCITATION_STATUS = "amb_msgs/msg/ExcitationStatus"


def answer_from_message(message: Any) -> AppliedExcitation:
    """The excitation that an ExcitationStatus message answers, and the answer."""
    return AppliedExcitation(
        run=int(message.run),
        id=int(message.id),
        kind=bounded(str(message.kind), LONGEST_KIND),
        accepted=bool(message.accepted),
        message=bounded(str(message.message)),
        first_step=int(message.first_step),
        steps=int(message.steps),
    )

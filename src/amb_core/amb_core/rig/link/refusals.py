"""Why a target refuses a command, as an error of one line."""

from __future__ import annotations

from amb_core.ground.errors import TargetError
from amb_core.rig.link.answers import Reply
from amb_core.rig.link.commands import Command
from amb_core.rig.link.layout import Code, ExcitationPhase, FrameType, TargetState
from amb_core.rig.link.link import NoRecordError, TooLateError

_REASONS = {
    Code.BAD_LENGTH: "it has another length than this version of the protocol expects",
    Code.BAD_VALUE: "a value is not allowed",
    Code.BEYOND_LIMIT: "it is beyond the target's limits",
    Code.UNKNOWN: "it is unknown to this firmware",
    Code.NO_UPLOAD: "the upload is not there any more",
    Code.INCOMPLETE: "parts of the upload are missing",
    Code.CHECKSUM: "the upload has another checksum",
    Code.LATCHED: "trips are latched; reset them first",
    Code.TOO_LARGE: "it is larger than the target has room for",
    Code.BUSY: "the target is busy",
    Code.LOCKED: "it is locked after a trip by displacement; wait for its lock_time, and look at the rotor",
}


def require_done(where: str, command: Command, reply: Reply) -> None:
    """Raise TargetError, TooLateError for a step that has passed, unless a command was executed, or can be soon."""
    if reply.code in (Code.DONE, Code.BUSY):
        return
    if reply.code is Code.TOO_LATE:
        raise TooLateError(command.step, reply.status.step)
    reason = _REASONS.get(reply.code, f"it is {reply.status.state.name.lower()}")
    if (command.type, reply.code, reply.status.state) == (FrameType.LEVITATE, Code.WRONG_STATE, TargetState.OFF):
        reason = "it has measured nothing since its start, or since the latest reset"
    if command.type is FrameType.RECORD and reply.code is Code.WRONG_STATE:
        raise NoRecordError(f"{where} keeps nothing: no trip since its start or reset, or no memory for it")
    if command.type is FrameType.RECORD and reply.code is Code.UNKNOWN:
        raise NoRecordError(f"{where} has firmware that keeps nothing")
    if reply.code is Code.WRONG_STATE and reply.status.excitation is not ExcitationPhase.NONE:
        reason += f", with an excitation {reply.status.excitation.name.lower()}"
    raise TargetError(f"{where} refuses {command.type.name}: {reason}")

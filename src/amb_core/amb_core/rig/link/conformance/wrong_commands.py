"""Commands of AMB-UDP that are genuine, and wrong: with values, lengths or in states that a target must refuse."""

from __future__ import annotations

import math
import struct
from dataclasses import replace

from amb_core.rig.link import commands
from amb_core.rig.link.commands import Command
from amb_core.rig.link.conformance.exchange import Exchange
from amb_core.rig.link.layout import Code, FrameType, Law


def wrong_commands(target: Exchange) -> tuple[tuple[str, Command, tuple[Code, ...]], ...]:
    """Genuine commands, wrong but for a few that restore what the others could have changed.

    Parameters
    ----------
    target : Exchange
        The target, off.

    Returns
    -------
    tuple of (str, Command, tuple of Code)
        What each is, the command, and the codes with which a target may answer it.
    """
    axes, limits = target.session.axes, target.description.limits
    none = struct.pack(f"<{axes}d", *(0.0,) * axes)

    def parameters(kind: int, block: bytes) -> Command:
        return Command(FrameType.PARAMETERS, struct.pack("<Q", kind) + block)

    nan = struct.pack(f"<{axes}d", *(math.nan,) * axes)
    far = struct.pack(f"<{axes}d", *(1.0,) * axes)
    raised = replace(limits, control_current=limits.control_current * 1.01)
    gains = struct.pack("<5d", 1e3, 1.0, 0.0, 1e4, 1.0)
    return (
        ("HEARTBEAT with a body", Command(FrameType.HEARTBEAT, b"x"), (Code.BAD_LENGTH,)),
        ("LEVITATE for NaN seconds", commands.levitate(math.nan), (Code.BAD_VALUE,)),
        ("LEVITATE for 61 s", commands.levitate(61.0), (Code.BAD_VALUE,)),
        ("DELEVITATE in -1 s", commands.delevitate(-1.0), (Code.BAD_VALUE,)),
        ("DELEVITATE in 1 s while off", commands.delevitate(1.0), (Code.WRONG_STATE,)),
        ("DELEVITATE at once while off", commands.delevitate(0.0), (Code.DONE,)),
        ("PARAMETERS of an unknown kind", parameters(9, none), (Code.UNKNOWN,)),
        ("PARAMETERS of a kind beyond a byte", parameters(257, gains * axes), (Code.UNKNOWN,)),
        ("PARAMETERS of a wrong length", parameters(2, none + bytes(8)), (Code.BAD_LENGTH,)),
        ("a nominal reference of NaN", parameters(2, nan), (Code.BAD_VALUE,)),
        ("a nominal reference beyond the alarm", parameters(2, far), (Code.BAD_VALUE,)),
        ("a landing reference beyond the clearance", parameters(3, far), (Code.BAD_VALUE,)),
        ("gains of NaN", parameters(1, struct.pack("<d", math.nan) * 5 * axes), (Code.BAD_VALUE,)),
        ("negative gains", parameters(1, struct.pack("<d", -1.0) * 5 * axes), (Code.BAD_VALUE,)),
        ("right gains", parameters(1, gains * axes), (Code.DONE,)),
        ("a limit above the configuration", commands.limits(raised), (Code.BAD_VALUE,)),
        ("a limit of 0", parameters(4, bytes(8) + limits.to_bytes()[8:]), (Code.BAD_VALUE,)),
        ("an unknown controller", Command(FrameType.CONTROLLER, struct.pack("<Q", 9)), (Code.BAD_VALUE,)),
        ("a state-space controller without matrices", commands.controller(Law.STATE_SPACE),
         (Code.WRONG_STATE, Code.DONE)),
        ("STREAM of more than a frame holds", commands.stream(2000), (Code.TOO_LARGE,)),
        ("STREAM with unknown options", commands.stream(1, 64), (Code.BAD_VALUE,)),
        ("ARM while off", commands.arm(1, 1 << 40), (Code.WRONG_STATE,)),
        ("BITMAP of an unknown upload", Command(FrameType.BITMAP, struct.pack("<I", 12345)), (Code.NO_UPLOAD,)),
        ("the limits of the configuration", commands.limits(limits), (Code.DONE,)),
        ("the PD law", commands.controller(Law.PD), (Code.DONE,)),
    )  # fmt: skip

"""Real-time targets: the frames of AMB-UDP (docs/reference/target-protocol.md), and the target in this process."""

from amb_core.rig.link.amb_udp import PORT, SILENCE, AmbUdpLink
from amb_core.rig.link.answers import Answer, Reply, TargetStatus, TelemetryBlock, Trip, decode
from amb_core.rig.link.commands import Command, CommandWriter
from amb_core.rig.link.description import Description, machine_of
from amb_core.rig.link.frames import Refusal, Session, hello
from amb_core.rig.link.in_order import InOrder, TelemetryCount
from amb_core.rig.link.layout import (
    Code,
    ExcitationPhase,
    FrameType,
    Law,
    Limits,
    TargetState,
    TelemetryOption,
    TripReason,
)
from amb_core.rig.link.link import (
    HostLoopLink,
    LevitatedError,
    LinkCount,
    LinkListener,
    NoRecordError,
    RebootedError,
    TargetDescription,
    TargetLink,
    TargetSettings,
    TooLateError,
)
from amb_core.rig.link.reference import LOOPBACK, Peer, ReferenceTarget, build_library
from amb_core.rig.link.upload import Upload, controller_upload, excitation_upload

__all__ = [
    "LOOPBACK",
    "PORT",
    "SILENCE",
    "AmbUdpLink",
    "Answer",
    "Code",
    "Command",
    "CommandWriter",
    "Description",
    "ExcitationPhase",
    "FrameType",
    "HostLoopLink",
    "InOrder",
    "Law",
    "LevitatedError",
    "Limits",
    "LinkCount",
    "LinkListener",
    "NoRecordError",
    "Peer",
    "RebootedError",
    "ReferenceTarget",
    "Refusal",
    "Reply",
    "Session",
    "TargetDescription",
    "TargetLink",
    "TargetSettings",
    "TargetState",
    "TargetStatus",
    "TelemetryBlock",
    "TelemetryCount",
    "TelemetryOption",
    "TooLateError",
    "Trip",
    "TripReason",
    "Upload",
    "build_library",
    "controller_upload",
    "decode",
    "excitation_upload",
    "hello",
    "machine_of",
]

"""Real-time targets: the frames of AMB-UDP (docs/reference/target-protocol.md), and the target in this process."""

from amb_core.target.amb_udp import PORT, SILENCE, AmbUdpLink
from amb_core.target.answers import Answer, Reply, TargetStatus, TelemetryBlock, Trip, decode
from amb_core.target.commands import Command, CommandWriter
from amb_core.target.description import Description, machine_of
from amb_core.target.frames import Refusal, Session, hello
from amb_core.target.in_order import InOrder, TelemetryCount
from amb_core.target.layout import (
    Code,
    ExcitationPhase,
    FrameType,
    Law,
    Limits,
    TargetState,
    TelemetryOption,
    TripReason,
)
from amb_core.target.link import (
    HostLoopLink,
    LinkCount,
    LinkListener,
    TargetDescription,
    TargetLink,
    TargetSettings,
    TooLateError,
)
from amb_core.target.reference import LOOPBACK, Peer, ReferenceTarget, build_library
from amb_core.target.upload import Upload, controller_upload, excitation_upload

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
    "Limits",
    "LinkCount",
    "LinkListener",
    "Peer",
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

"""Whose commands the C target takes: authentic, new, and each once."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest

from amb_core.rig.link import (
    LOOPBACK,
    Code,
    CommandWriter,
    FrameType,
    Limits,
    Peer,
    Refusal,
    Reply,
    Session,
    TargetState,
    commands,
    decode,
    hello,
)
from amb_core.rig.link.frames import encode
from tests.target_rig import HOST, KEY, Rig


def test_a_command_with_another_key_is_not_answered() -> None:
    rig = Rig()
    stranger = CommandWriter(Session(rig.session.nonce, 2, 0, bytes(32)), 100)
    assert rig.send(stranger.write(commands.levitate())) == []
    assert (rig.status().forged, rig.status().counter) == (1, 2)


def test_the_same_frame_again_is_answered_and_done_once() -> None:
    rig = Rig(2, Limits(settle_time=1e-4))
    rig.step((1e-6, 0.0))
    frame = rig.writer.write(commands.levitate())
    first, again = rig.send(frame), rig.send(frame)
    assert [reply.code for reply in first + again if isinstance(reply, Reply)] == [Code.DONE, Code.DONE]
    rig.noise(5)
    rig.step((200e-6, 0.0))
    assert rig.status().state == TargetState.TRIPPED
    rig.command(commands.fault_reset())
    assert rig.send(frame) == []  # no longer the latest
    rig.step((1e-6, 0.0))
    assert not rig.target.enabled


def test_commands_out_of_order_are_not_taken() -> None:
    rig = Rig()
    frames = [rig.writer.write(commands.heartbeat()) for _ in range(20)]
    order = np.random.default_rng(1).permutation(20)
    answered = [bool(rig.send(frames[number])) for number in order]
    newest = np.maximum.accumulate(order)
    assert answered == [bool(number == highest) for number, highest in zip(order, newest, strict=True)]


def test_commands_of_before_a_reboot_are_not_taken() -> None:
    rig = Rig()
    rig.step((1e-6, 0.0))
    frames = [rig.writer.write(commands.levitate()) for _ in range(5)]
    rig.target.reboot()
    rig.step((1e-6, 0.0))
    assert [rig.send(frame) for frame in frames] == [[]] * 5
    rig.connect()
    assert (rig.status().bad, rig.status().state) == (5, TargetState.OFF)


@pytest.mark.parametrize(
    ("peer", "taken"),
    [(LOOPBACK, True), (HOST, False), (Peer(0x7F000001, 1, False), False)],
    ids=["loopback", "another machine", "another machine with an address like it"],
)
def test_without_a_key_commands_come_from_loopback_only(peer: Peer, taken: bool) -> None:
    rig = Rig(key=b"")
    rig.peer = peer
    assert bool(rig.send(rig.writer.write(commands.heartbeat()))) is taken


def test_a_hello_is_answered_with_no_more_bytes_than_it_has() -> None:
    rig = Rig(axes=16)

    for first in range(256):
        rig.target.feed(hello(first), HOST)
        assert [len(frame) <= len(hello()) for frame, _ in rig.target.take()] == [True]
    rig.target.feed(encode(FrameType.HELLO, bytes(8)), HOST)
    assert rig.target.take() == []


def test_a_hello_of_a_later_version_is_answered_with_ours() -> None:

    rig = Rig()
    later = hello()[:4] + b"\x07" + hello()[5:-4]
    rig.target.feed(later + struct.pack("<I", zlib.crc32(later)), HOST)
    ((answer, _),) = rig.target.take()
    assert answer[4] == 2


def test_telemetry_goes_to_whoever_asked_for_it_with_the_key() -> None:
    rig = Rig()
    rig.command(commands.stream(1))
    rig.target.feed(CommandWriter(Session(rig.session.nonce, 2, 0, bytes(32)), 9).write(commands.stream(1)), LOOPBACK)
    rig.step()
    ((_, to),) = rig.target.take()
    assert (to.address, to.port) == (HOST.address, HOST.port)


def test_a_reply_can_be_made_by_the_key_only() -> None:
    rig = Rig()
    rig.target.feed(rig.writer.write(commands.heartbeat()), HOST)
    ((frame, _),) = rig.target.take()

    assert isinstance(decode(frame, rig.session), Reply)
    assert isinstance(decode(frame, Session(rig.session.nonce, 2, 0, KEY[::-1])), Refusal)


def test_0_of_many_forged_commands_are_taken() -> None:
    rig = Rig()
    rng = np.random.default_rng(2)
    frames = [rig.writer.write(commands.heartbeat()) for _ in range(3)]
    rig.send(frames[-1])
    before = rig.status().counter
    for _ in range(3000):
        frame = bytearray(frames[int(rng.integers(3))])
        frame[24:32] = int(rng.integers(before + 1, 1 << 60)).to_bytes(8, "little")
        rig.target.feed(resummed(frame), HOST)
    assert rig.target.take() == []
    status = rig.status()
    assert (status.forged, status.counter) == (3000, before + 1)


def resummed(frame: bytearray) -> bytes:

    return bytes(frame[:-4]) + struct.pack("<I", zlib.crc32(frame[:-4]))

"""Frames of AMB-UDP: the recorded exchange, and bytes that are refused with a reason."""

from __future__ import annotations

import hashlib
import hmac
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import MachineError, TargetError
from amb_core.rig.link import (
    Code,
    CommandWriter,
    Description,
    FrameType,
    Limits,
    Refusal,
    Reply,
    Session,
    TargetState,
    TargetStatus,
    TelemetryBlock,
    TripReason,
    commands,
    decode,
    excitation_upload,
    hello,
    machine_of,
)
from amb_core.rig.link.frames import decode_frame, encode
from tests.target_rig import HOST, KEY, NONCE, Exchanged, Rig, exchange, golden, machine, replayed

SESSION = Session(NONCE, 2, 4, KEY)
ANSWERS = [item for item in golden() if not item.from_host]


def named(name: str) -> Exchanged:
    return next(item for item in golden() if item.name == name)


def answer_to(name: str) -> object:
    return decode(named(f"{name}: answer").frame, SESSION)


def test_host_and_target_send_the_recorded_bytes() -> None:
    assert exchange() == golden()


def test_the_recorded_file_alone_makes_a_port_send_the_same_bytes() -> None:
    assert replayed() == [item.frame for item in golden() if not item.from_host]


@pytest.mark.parametrize("item", golden(), ids=lambda item: item.name)
def test_frames_are_as_the_document_lays_them_out(item: Exchanged) -> None:
    frame = item.frame
    magic, version, kind, length, session = struct.unpack_from("<4sBBHI", frame)
    assert (magic, version, len(frame)) == (b"AMBU", 2, 24 + length + 4)
    assert len(frame) <= 1472
    assert struct.unpack("<I", frame[-4:])[0] == zlib.crc32(frame[:-4])
    assert (kind < 0x80) == item.from_host
    if kind not in (0x01, 0x90, 0x91):  # commands, replies and the description
        expected = hmac.new(KEY, NONCE + frame[:-20], hashlib.sha256).digest()[:16]
        assert (frame[-20:-4], session) == (expected, struct.unpack("<I", NONCE[:4])[0])


def test_the_description_becomes_the_machine() -> None:
    answer = answer_to("hello")
    assert isinstance(answer, Description)
    described, expected = machine_of([answer]), machine()
    assert described == expected
    assert answer.limits == Limits()
    assert (answer.coils, answer.with_key, answer.firmware_version) == (4, True, (1, 0, 0))


def test_a_machine_of_sixteen_axes_is_described_on_two_pages() -> None:
    rig = Rig(axes=16)
    pages = []
    for first in (8, 0):
        rig.target.feed(hello(first), HOST)
        pages += [decode(frame) for frame, _ in rig.target.take()]
    assert machine_of(pages) == machine(16)
    with pytest.raises(MachineError, match="8 axes"):
        machine_of(pages[:1])


def test_telemetry_carries_float64_bit_for_bit_and_float32_rounded() -> None:
    wide, narrow = answer_to("float64"), answer_to("float32")
    assert isinstance(wide, TelemetryBlock)
    assert isinstance(narrow, TelemetryBlock)
    steps = np.arange(4)
    np.testing.assert_array_equal(wide.position, np.stack([steps * 2.0**-20, -steps * 2.0**-21], axis=1))
    np.testing.assert_array_equal(wide.coil_current[:, 0], 2.5 + steps / 8)
    assert (wide.status & 7).tolist() == [TargetState.LEVITATING] * 4
    assert (wide.first_step, narrow.steps, narrow.coil_current, narrow.status) == (2, 5, None, None)
    assert narrow.position.dtype == np.float64


def test_replies_name_command_counter_and_code() -> None:
    reply = answer_to("controller refused while levitated")
    assert isinstance(reply, Reply)
    assert (reply.command, reply.code) == (FrameType.CONTROLLER, Code.WRONG_STATE)
    assert reply.status.counter == reply.counter
    assert answer_to("clock").clock == (123_456_789, 100_000)
    assert (answer_to("excitation bitmap 0").missing, answer_to("excitation bitmap 1").missing) == ((1,), ())


def test_a_status_names_the_trips_with_their_steps() -> None:
    status = answer_to("sensor failed")
    assert isinstance(status, TargetStatus)
    (trip,) = status.trips
    assert (trip.reason, trip.step, trip.axis, np.isnan(trip.value)) == (TripReason.SENSOR_RANGE, 34, 0, True)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda frame: frame[:20], "20 bytes"),
        (lambda frame: frame + bytes(1500), "bytes"),
        (lambda frame: b"X" + frame[1:], "magic"),
        (lambda frame: frame[:-1], "its header gives it"),
        (lambda frame: frame[:30] + bytes([frame[30] ^ 1]) + frame[31:], "checksum"),
        (lambda frame: resummed(frame[:4] + b"\7" + frame[5:]), "version 7"),
        (lambda frame: resummed(frame[:5] + b"\x33" + frame[6:]), "unknown type 0x33"),
        (lambda frame: resummed(frame[:8] + b"1234" + frame[12:]), "session"),
        (lambda frame: resummed(frame[:23] + b"\x80" + frame[24:]), "of step"),
        (lambda frame: commands_frame(), "is a command"),
    ],
)
def test_each_refused_datagram_has_its_reason(change, reason) -> None:
    refusal = decode(change(named("float64: answer").frame), SESSION)
    assert isinstance(refusal, Refusal)
    assert reason in refusal.reason


def test_a_reply_with_a_wrong_tag_is_refused() -> None:
    frame = named("heartbeat: answer").frame
    refusal = decode(resummed(frame[:40] + bytes([frame[40] ^ 1]) + frame[41:]), SESSION)
    assert refusal == Refusal("REPLY with a wrong tag")
    assert isinstance(decode(frame, SESSION), Reply)


def test_what_a_later_firmware_adds_is_left_alone() -> None:
    frame = decode_frame(named("sensor failed: answer").frame)
    longer = encode(frame.type, frame.payload + b"later", frame.session, frame.sequence, frame.step)
    assert isinstance(decode(longer, SESSION), TargetStatus)


def test_no_bytes_make_the_decoder_raise() -> None:
    rng = np.random.default_rng(5)
    refused = 0
    for number in range(4_000):
        frame = bytearray(ANSWERS[number % len(ANSWERS)].frame)
        for _ in range(rng.integers(1, 4)):
            place = int(rng.integers(5, len(frame)))
            frame[place : place + int(rng.integers(1, 3))] = rng.bytes(int(rng.integers(0, 4)))
        frame = frame[: max(28, len(frame))][:1472]
        if number % 4:  # reaches what lies behind the checksum
            frame[6:8] = (len(frame) - 28).to_bytes(2, "little")
            frame = bytearray(resummed(bytes(frame)))
        refused += isinstance(decode(bytes(frame), SESSION), Refusal)
    assert refused > 2_000


def test_numbers_that_no_frame_may_carry_are_refused_at_once() -> None:
    with pytest.raises(TargetError, match="up to 1472"):
        CommandWriter(SESSION).write(commands.nominal_reference([0.0] * 200))
    with pytest.raises(TargetError, match="16 to 64"):
        Session(NONCE, 2, 0, b"short")
    with pytest.raises(TargetError, match="not finite"):
        excitation_upload(1, [[np.nan, 0.0]])
    with pytest.raises(TargetError, match="trip_share"):
        Limits(trip_share=float("nan"))


def test_a_key_does_not_show_in_messages() -> None:
    assert KEY.hex() not in repr(SESSION)
    assert repr(KEY) not in repr(SESSION)


def test_the_document_gives_every_number_its_name() -> None:
    text = (Path(__file__).parents[2] / "docs" / "reference" / "target-protocol.md").read_text()
    for kind in FrameType:
        assert re.search(rf"(\| |\*\*)0x{int(kind):02X}( \| | ){kind.name}\b", text), kind
    for code in Code:
        assert re.search(rf"\| {int(code)} \| {code.name}\b", text), code
    for reason in TripReason:
        assert f"| {int(reason)} {reason.name} |" in text
    for state in TargetState:
        assert f"{state.name} {int(state)}" in text


def resummed(frame: bytes) -> bytes:
    return frame[:-4] + struct.pack("<I", zlib.crc32(frame[:-4]))


def commands_frame() -> bytes:
    return CommandWriter(SESSION).write(commands.heartbeat())

"""AMB-UDP over byte streams: COBS in C and in Python, and a target behind a pseudo-terminal."""

from __future__ import annotations

import ctypes
import fcntl
import functools
import os
import struct
import subprocess
import tempfile
import termios
import tty
from pathlib import Path

import numpy as np
import pytest

from amb_core.ground.errors import TargetError
from amb_core.rig.emulation.listening import PSEUDO_TERMINAL, SerialListening
from amb_core.rig.link import LOOPBACK
from amb_core.rig.link.byte_stream import LONGEST, StreamReader, from_stream, to_stream
from amb_core.rig.link.conformance import Exchange, check_target
from amb_core.rig.link.layout import LARGEST_FRAME
from amb_core.rig.link.reference import COMPILER, SOURCE
from amb_core.rig.link.wire import SerialWire, open_wire
from tests.served_emulator import ServedEmulator
from tests.target_rig import UNDEFINED, golden

FRAMES = [item.frame for item in golden()]
PUBLISHED = [
    (b"\0", "0101"), (b"\0\0", "010101"), (b"\0\x11\0", "01021101"), (b"\x11\x22\0\x33", "0311220233"),
    (b"\x11\x22\x33\x44", "0511223344"), (b"\x11\0\0\0", "0211010101"), (bytes(range(1, 255)), None),
]  # fmt: skip
"""Examples that descriptions of COBS give; the longest run without a zero has a code of its own."""
TERMINAL_QUEUE = 4095  # bytes that wait for a terminal's reader, at most


class Stream(ctypes.Structure):
    """`struct amb_stream`."""

    _fields_ = (
        ("frame", ctypes.c_uint8 * LARGEST_FRAME), ("length", ctypes.c_uint16), ("left", ctypes.c_uint8),
        ("zero", ctypes.c_bool), ("broken", ctypes.c_bool),
    )  # fmt: skip


@functools.cache
def stream_code() -> Path:
    """The C code of streams, compiled once a test run."""
    library = Path(tempfile.mkdtemp(prefix="stream")) / "stream.so"
    source = SOURCE / "ports" / "stream.c"
    subprocess.run([*COMPILER, *UNDEFINED, "-shared", "-fPIC", "-o", library, source], check=True)
    return library


class TargetStream:
    """The target's side of a stream, as a port uses it."""

    def __init__(self) -> None:
        self._code = ctypes.CDLL(str(stream_code()))
        self._code.amb_stream_take.restype = self._code.amb_stream_put.restype = ctypes.c_size_t
        self._stream = Stream()

    def take(self, received: bytes) -> list[bytes]:
        frames = []
        for byte in received:
            length = self._code.amb_stream_take(ctypes.byref(self._stream), ctypes.c_uint8(byte))
            if length > LARGEST_FRAME:
                frames.append(b"")
            elif length:
                frames.append(bytes(self._stream.frame[:length]))
        return frames

    def put(self, frame: bytes) -> bytes:
        out = ctypes.create_string_buffer(LONGEST + 1)
        length = self._code.amb_stream_put(frame, ctypes.c_size_t(len(frame)), out)
        return out.raw[:length]


@pytest.fixture(params=[StreamReader, TargetStream])
def reader(request: pytest.FixtureRequest):
    return request.param()


@pytest.mark.parametrize(("frame", "expected"), PUBLISHED)
def test_the_bytes_are_those_of_published_examples(frame: bytes, expected: str | None) -> None:
    coded = to_stream(frame)
    if expected is not None:
        assert coded.hex() == expected + "00"
    assert (coded.count(0), coded[-1]) == (1, 0)
    assert from_stream(coded[:-1]) == frame


@pytest.mark.parametrize("frame", [*FRAMES, *(example for example, _ in PUBLISHED)], ids=len)
def test_target_and_host_send_the_same_bytes(frame: bytes) -> None:
    assert TargetStream().put(frame) == to_stream(frame)


@pytest.mark.parametrize("length", [1, 253, 254, 255, 508, 509, LARGEST_FRAME])
@pytest.mark.parametrize("zeros", [0.0, 0.01, 0.5, 1.0])
def test_every_frame_comes_back(reader: StreamReader | TargetStream, length: int, zeros: float) -> None:
    rng = np.random.default_rng(length)
    values = np.where(rng.random(length) < zeros, 0, rng.integers(1, 256, length))
    frame = values.astype(np.uint8).tobytes()
    stream = to_stream(frame)
    assert len(stream) <= LONGEST + 1
    assert reader.take(stream) == [frame]


def test_the_recorded_exchange_passes_byte_by_byte_and_in_one_piece(reader: StreamReader | TargetStream) -> None:
    stream = b"".join(map(to_stream, FRAMES))
    assert reader.take(stream) == FRAMES
    assert [frame for byte in stream for frame in reader.take(bytes([byte]))] == FRAMES


def test_what_is_too_long_is_refused_and_the_next_frame_is_whole(reader: StreamReader | TargetStream) -> None:
    for longer in (b"\1" * (LARGEST_FRAME + 1), bytes(LARGEST_FRAME + 1), b"\1" * 100_000):
        assert reader.take(to_stream(longer) + to_stream(FRAMES[0])) == [b"", FRAMES[0]]


def test_a_stream_that_begins_amid_a_frame_is_found(reader: StreamReader | TargetStream) -> None:
    assert reader.take(to_stream(FRAMES[0])[100:] + to_stream(FRAMES[1]))[-1] == FRAMES[1]


@pytest.mark.parametrize("fault", ["lost", "changed", "inserted"])
def test_lost_and_garbled_bytes_cost_the_frames_that_they_touch(
    reader: StreamReader | TargetStream, fault: str
) -> None:
    """A byte that is lost or changed touches its frame, and if it was or becomes an end, one neighbour."""
    rng = np.random.default_rng(7)
    for _ in range(100 if isinstance(reader, TargetStream) else 1_000):
        at = int(rng.integers(1, 4))
        sent = [FRAMES[int(rng.integers(len(FRAMES)))] for _ in range(6)]
        coded = [to_stream(frame) for frame in sent]
        place = int(rng.integers(len(coded[at])))
        byte = bytes([int(rng.integers(256))])
        changed = {"lost": b"", "changed": byte, "inserted": byte + coded[at][place : place + 1]}[fault]
        coded[at] = coded[at][:place] + changed + coded[at][place + 1 :]
        table = reader.take(b"".join(coded))
        assert table[:at] == sent[:at]
        assert table[-(4 - at) :] == sent[at + 2 :]


def test_both_sides_find_the_same_frames_in_any_bytes() -> None:
    host, target, rng, cut = StreamReader(), TargetStream(), np.random.default_rng(11), 0
    for _ in range(300):
        stream = bytearray(b"".join(to_stream(FRAMES[number]) for number in rng.integers(len(FRAMES), size=3)))
        for _ in range(int(rng.integers(8))):
            place = int(rng.integers(len(stream)))
            stream[place : place + int(rng.integers(4))] = rng.bytes(int(rng.integers(4)))
        frames = host.take(bytes(stream))
        assert frames == target.take(bytes(stream))
        cut += frames.count(b"")
    assert cut > 100


@pytest.mark.parametrize("key", [b"", bytes(range(32))])
def test_a_target_behind_a_pseudo_terminal_keeps_to_the_protocol(key: bytes) -> None:
    with ServedEmulator(key=key, host=PSEUDO_TERMINAL, limits={"host_time": 0.02}) as served:
        served.emulator.plant.reset()
        target = Exchange(served.address, 0, key, 5.0)
        try:
            assert [one for one in check_target(target) if one.check != "timing"] == []  # it runs as fast as it can
        finally:
            target.close()


def test_the_recorded_frames_pass_a_pseudo_terminal_both_ways() -> None:
    listening = SerialListening()
    wire = open_wire(f"{listening.where}?baud=115200", 0)
    try:
        for frame in FRAMES:
            wire.send(frame)
            while (received := listening.receive()) is None:
                pass
            assert received == (frame, LOOPBACK)
            assert listening.send(frame, LOOPBACK)
            assert wire.receive(60.0) == frame
    finally:
        wire.close()
        listening.close()


def fill(host: int, device: int) -> None:
    """Fill a pseudo-terminal: the device's side, and the queue into which the kernel moves bytes when it finds time."""
    os.set_blocking(device, False)
    full = False
    while not full:
        full = struct.unpack("i", fcntl.ioctl(host, termios.FIONREAD, b"\0" * 4))[0] == TERMINAL_QUEUE
        with pytest.raises(BlockingIOError):
            while True:
                os.write(device, b"\x7f" * 1_000)


def test_a_line_that_nobody_reads_loses_frames_and_goes_on() -> None:
    host, device = os.openpty()
    tty.setraw(device)
    wire = SerialWire(os.ttyname(device))
    try:
        fill(host, device)
        wire.send(FRAMES[0])  # no room
        os.set_blocking(host, False)
        reader, before = StreamReader(), []
        with pytest.raises(BlockingIOError):
            while True:
                before += reader.take(os.read(host, 1 << 16))
        assert before == []
        wire.send(FRAMES[1])
        assert reader.take(os.read(host, 1 << 16)) == [b"", FRAMES[1]]
    finally:
        wire.close()
        os.close(host)
        os.close(device)


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("serial:ttyACM0", "allowed: serial:/dev/DEVICE"),
        ("serial:/dev/ttyACM0?speed=9600", "allowed: serial:/dev/DEVICE"),
        ("serial:/dev/null?baud=12345", "allowed: 50, 75, "),
        ("serial:/dev/null", "cannot be reached"),
        (f"serial:{Path('/dev')}/no_such_device", "cannot be reached: No such file"),
    ],
)
def test_an_address_that_is_no_stream_is_refused_in_one_line(address: str, message: str) -> None:
    with pytest.raises(TargetError, match=message):
        Exchange(address, 0, b"")

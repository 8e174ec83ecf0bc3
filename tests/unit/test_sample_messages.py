"""The loop's own serialization is that of ROS, byte for byte but for padding."""

import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from amb_core.ground.errors import MessageError
from amb_msgs.msg import CurrentReference, RotorPosition
from amb_ros.sample_messages import pack_current, pack_position, unpack_current, unpack_position
from tests.fuzz.hostile import UNREADABLE

RUN = st.integers(0, 2**64 - 1)
STEP = st.integers(0, 2**64 - 1)
NUMBER = st.floats(allow_nan=False)
AXES = st.lists(NUMBER, min_size=1, max_size=9)


def meaningful(data: bytes, padding: int) -> tuple[bytes, bytes]:
    """A message without the 4 bytes that align its doubles: ROS leaves there what its memory held before."""
    return data[:padding], data[padding + 4 :]


@given(RUN, STEP, NUMBER, AXES)
def test_position_is_serialized_as_ros_does(run, step, time, axes):
    message = RotorPosition(run=run, step=step, time=time, position=axes)
    assert meaningful(pack_position(run, step, time, axes), 32) == meaningful(serialize_message(message), 32)
    assert deserialize_message(pack_position(run, step, time, axes), RotorPosition) == message
    assert unpack_position(serialize_message(message)) == (run, step, time, tuple(axes))


@given(RUN, STEP, AXES)
def test_current_reference_is_serialized_as_ros_does(run, step, axes):
    message = CurrentReference(run=run, step=step, current=axes)
    assert meaningful(pack_current(run, step, axes), 24) == meaningful(serialize_message(message), 24)
    assert deserialize_message(pack_current(run, step, axes), CurrentReference) == message
    assert unpack_current(serialize_message(message)) == (run, step, tuple(axes))


def test_messages_of_a_big_endian_machine_are_understood():
    position = b"\x00\x00\x00\x00" + struct.pack(">QQdI4xdd", 3, 7, 7e-4, 2, 1e-6, -2e-6)
    run, step, time, axes = unpack_position(position)
    assert (run, step, time, list(axes)) == (3, 7, 7e-4, [1e-6, -2e-6])
    current = b"\x00\x00\x00\x00" + struct.pack(">QQI4xdd", 3, 7, 2, 0.5, -1.5)
    run, step, axes = unpack_current(current)
    assert (run, step, list(axes)) == (3, 7, [0.5, -1.5])


def test_messages_without_values_are_understood():
    assert unpack_position(serialize_message(RotorPosition(run=3, step=7)))[3] == ()
    assert unpack_current(serialize_message(CurrentReference(run=3, step=7)))[2] == ()


@pytest.mark.parametrize("count", [1, 2**31, 2**32 - 1])
def test_a_length_beyond_the_message_gives_no_values(count):
    assert unpack_position(b"\x00\x01\x00\x00" + struct.pack("<QQdI", 3, 7, 7e-4, count))[3] == ()
    assert unpack_current(b"\x00\x01\x00\x00" + struct.pack("<QQI", 3, 7, count))[2] == ()


@pytest.mark.parametrize("data", UNREADABLE, ids=len)
def test_bytes_that_are_no_message_are_refused(data):
    with pytest.raises(MessageError, match=rf"the message cannot be read: its {len(data)} bytes are no RotorPosition"):
        unpack_position(data)
    with pytest.raises(MessageError, match=rf"the message cannot be read: its {len(data)} bytes are no CurrentRefer"):
        unpack_current(data)


@given(st.binary(max_size=80))
def test_no_bytes_do_more_than_be_refused(data):
    for unpack in (unpack_position, unpack_current):
        with contextlib.suppress(MessageError):
            unpack(data)

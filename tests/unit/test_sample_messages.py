"""The loop's own serialization is that of ROS, byte for byte."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from amb_msgs.msg import CurrentReference, RotorPosition
from amb_ros.sample_messages import pack_current, pack_position, unpack_current, unpack_position

RUN = st.integers(0, 2**64 - 1)
STEP = st.integers(0, 2**64 - 1)
NUMBER = st.floats(allow_nan=False)


@given(RUN, STEP, NUMBER, NUMBER, NUMBER)
def test_position_is_serialized_as_ros_does(run, step, time, x, y):
    message = RotorPosition(run=run, step=step, time=time, x=x, y=y)
    assert pack_position(run, step, time, x, y) == serialize_message(message)
    assert deserialize_message(pack_position(run, step, time, x, y), RotorPosition) == message
    assert unpack_position(serialize_message(message)) == (run, step, time, x, y)


@given(RUN, STEP, NUMBER, NUMBER)
def test_current_reference_is_serialized_as_ros_does(run, step, i_x, i_y):
    message = CurrentReference(run=run, step=step, i_x=i_x, i_y=i_y)
    assert pack_current(run, step, i_x, i_y) == serialize_message(message)
    assert deserialize_message(pack_current(run, step, i_x, i_y), CurrentReference) == message
    assert unpack_current(serialize_message(message)) == (run, step, i_x, i_y)


def test_messages_of_a_big_endian_machine_are_understood():
    position = b"\x00\x00\x00\x00" + struct.pack(">QQddd", 3, 7, 7e-4, 1e-6, -2e-6)
    assert unpack_position(position) == (3, 7, 7e-4, 1e-6, -2e-6)
    current = b"\x00\x00\x00\x00" + struct.pack(">QQdd", 3, 7, 0.5, -1.5)
    assert unpack_current(current) == (3, 7, 0.5, -1.5)

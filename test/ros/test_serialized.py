"""Templates of serialised messages."""
from gdmp_msgs.msg import RobotState
import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from gdmp_ros.ros import serialized
from gdmp_ros.ros.messages import fill_robot_state, ROBOT_STATE_FIXED


def padding_of(message, kind):
    """Bytes that mean nothing: without an effect on what is read."""
    data = bytearray(serialize_message(message))
    found = []
    for i in range(4, len(data)):
        data[i] ^= 0xFF
        try:
            if deserialize_message(bytes(data), kind) == message:
                found.append(i)
        except Exception:  # a length that is wrong now
            pass
        data[i] ^= 0xFF
    return found


def test_padding_with_any_content_does_not_hide_a_field(monkeypatch, rng):
    message = RobotState()
    message.header.frame_id = 'panda_link0'
    count = ROBOT_STATE_FIXED + 21
    fill_robot_state(message, np.arange(count, dtype=float))
    padding = padding_of(message, RobotState)
    assert padding

    def serialize(one):
        data = bytearray(serialize_message(one))
        for i in padding:
            data[i] = rng.integers(256)
        return bytes(data)
    monkeypatch.setattr(serialized, 'serialize_message', serialize)
    template = serialized.SerializedTemplate(message, count, fill_robot_state)
    numbers = rng.standard_normal(count)
    read = deserialize_message(template.bytes(numbers, 3_000_000_007, 5, 2, 77), RobotState)
    assert (read.sequence, read.mode, read.tick) == (5, 2, 77)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (3, 7)
    fill_robot_state(message, numbers)
    assert read.position == message.position and read.commanded_wrench == message.commanded_wrench

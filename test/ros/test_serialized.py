"""Templates of serialised messages, and readers of them."""
from gdmp_msgs.msg import Reference, RobotState
from geometry_msgs.msg import TransformStamped, WrenchStamped
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.errors import DataError
from gdmp_ros.ros import serialized
from gdmp_ros.ros.messages import (
    fill_joint_reference,
    fill_reference,
    fill_robot_state,
    fill_wrench,
    ROBOT_STATE_FIXED,
)
from gdmp_ros.ros.serialized import deserialized, ReferenceReader, SerializedTemplate


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


def reference(frame, numbers=None, joints=None):
    message = Reference(sequence=41, mode=Reference.HOLDING)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 345
    if numbers is not None:
        fill_reference(message, numbers)
    if joints is not None:
        fill_joint_reference(message, joints)
    return message


@pytest.mark.parametrize('frame', ['base', 'base_2', 'bast', '', 'prüfstand'])
def test_references_of_the_frame_and_of_others_are_read_alike(monkeypatch, rng, frame):
    numbers = rng.standard_normal(TARGET_SIZE)
    slow = []
    monkeypatch.setattr(serialized, 'deserialized',
                        lambda data, kind: slow.append(0) or deserialized(data, kind))
    for known in ('base', frame):
        read = ReferenceReader(known).read(serialize_message(reference(frame, numbers)))
        assert (read.target == numbers).all()
        assert read[1:] == (frame, 12_000_000_345, 41, Reference.HOLDING)
    assert len(slow) == (frame != 'base')


@pytest.mark.parametrize('frame', ['base', 'ba', 'prüfstand', ''])
@pytest.mark.parametrize('known', [7, 6, 1])
def test_references_of_joints_and_what_is_no_reference(monkeypatch, rng, frame, known):
    slow = []
    monkeypatch.setattr(serialized, 'deserialized',
                        lambda data, kind: slow.append(0) or deserialized(data, kind))
    joints = resting_joints(rng.standard_normal(7), np.ones(7), 0.3)
    reader = ReferenceReader(frame, known)
    read = reader.read(serialize_message(reference(frame, joints=joints)))
    assert (read.target == joints).all()
    assert read[1:] == (frame, 12_000_000_345, 41, Reference.HOLDING)
    assert len(slow) == (known != 7)
    # As many numbers, otherwise divided.
    message = reference(frame, joints=joints)
    message.joints[0].position.append(0.0)
    message.joints[0].stiffness.pop()
    before = len(slow)
    with pytest.raises(DataError, match='8 positions, 7 velocities and 6 stiffnesses'):
        reader.read(serialize_message(message))
    assert len(slow) == before + 1
    with pytest.raises(DataError, match='not a Reference'):
        reader.read(serialize_message(reference('base'))[:200])


def test_all_stamps_of_a_message_are_replaced(rng):
    def fill(message, numbers):
        for one, x in zip(message.transforms, numbers):
            one.transform.translation.x = float(x)
    message = TFMessage(transforms=[TransformStamped(child_frame_id='x' * i) for i in range(3)])
    template = SerializedTemplate(message, 3, fill, [one.header for one in message.transforms])
    numbers = rng.standard_normal(3)
    read = deserialize_message(template.bytes(numbers, 7_000_000_009), TFMessage)
    assert [(one.header.stamp.sec, one.header.stamp.nanosec) for one in read.transforms] == (
        [(7, 9)] * 3)
    assert [one.transform.translation.x for one in read.transforms] == numbers.tolist()


def joint_state(names, position, velocity=(), effort=(), stamp=5):
    message = JointState(name=list(names), position=list(position), velocity=list(velocity),
                         effort=list(effort))
    message.header.stamp.sec = stamp
    return message


def all_numbers(message):
    return [*message.position, *message.velocity, *message.effort]


def all_parts(message):
    return [len(message.name), *message.name, message.position, message.velocity, message.effort]


def fill_joints(message, numbers):
    values = iter(numbers.tolist())
    for field in ('position', 'velocity', 'effort'):
        setattr(message, field, [next(values) for _ in getattr(message, field)])


def test_messages_that_are_alike_are_read_quickly_and_others_as_what_they_are():
    deserialised = []

    def about(message):
        deserialised.append(message)
        return message
    reader = serialized.AlikeReader(JointState, all_numbers, fill_joints, all_parts, about)
    names = ['shoulder', 'elbow', 'wrist']
    numbers = [0.1, -2.0, 3.0, 0.0, 0.0, 0.0]

    def read(message):
        return reader.read(serialize_message(message))
    first, alike = read(joint_state(names, numbers[:3], numbers[3:]))
    assert alike.about.name == names and first.tolist() == numbers
    again, alike = read(joint_state(names, [1.0, 2.0, 4.0], [5.0, 6.0, 7.0], stamp=9))
    assert len(deserialised) == 1 and again.tolist() == [1.0, 2.0, 4.0, 5.0, 6.0, 7.0]
    # As long, with other names, and with efforts instead of velocities; in turns.
    others = [joint_state(['shoulder', 'wrist', 'elbow'], numbers[:3], numbers[3:]),
              joint_state(names, numbers[:3], effort=numbers[3:])]
    for other in (*others, *others):
        found, alike = read(other)
        assert alike.about == other and found.tolist() == numbers
    assert len(deserialised) == 3
    found, alike = read(joint_state([], []))
    assert alike.template is None and found.size == 0
    with pytest.raises(DataError):
        reader.read(serialize_message(joint_state(names, numbers[:3], numbers[3:]))[:30])


def test_a_wrench_is_read_quickly():
    message = WrenchStamped()
    message.header.frame_id = 'tool0'
    reader = serialized.AlikeReader(WrenchStamped, lambda one: [
        one.wrench.force.x, one.wrench.force.y, one.wrench.force.z, one.wrench.torque.x,
        one.wrench.torque.y, one.wrench.torque.z], fill_wrench, lambda _: [])
    for k in range(3):
        fill_wrench(message, np.arange(6.0) + k)
        found, alike = reader.read(serialize_message(message))
        assert found.tolist() == (np.arange(6.0) + k).tolist()
    assert alike.fits(serialize_message(message))

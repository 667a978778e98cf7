"""Recorded runs are read from bags."""

import pytest

from gdmp_ros.data import runs
from gdmp_ros.data.bags import BagWriter, message_of, opened, REFERENCE
from gdmp_ros.errors import DataError


def test_runs_of_several_robots_are_distinguished_by_their_namespace(tmp_path):
    from gdmp_msgs.msg import Reference, RobotState
    from rclpy.serialization import serialize_message

    from gdmp_ros.ros.recorder.record import definition
    with BagWriter(tmp_path / 'both', 'mcap') as bag:
        for i in range(20):
            for robot, x in (('left', 0.3), ('right', 0.6)):
                for name, kind, message in (
                        (f'/{robot}/trajectory_server/reference', REFERENCE, Reference()),
                        (f'/{robot}/panda_sim/state', runs.STATE, RobotState())):
                    message.header.stamp.nanosec, message.sequence = i * 1_000_000, i + 1
                    message.pose.position.x, message.pose.orientation.w = x, 1.0
                    if kind == runs.STATE:
                        message.position = message.velocity = message.torque = [0.0] * 7
                    bag.raw(name, kind, 1 + i * 1_000_000, serialize_message(message),
                            *definition(kind))
    for robot, x in (('left', 0.3), ('/right', 0.6)):
        run = runs.read(tmp_path / 'both', robot)
        assert len(run.references) == 20 and (run.poses[:, 0] == x).all()
    with pytest.raises(DataError, match='expected one topic with references, the bag has '
                                        '/left/trajectory_server/reference, /right/'):
        runs.read(tmp_path / 'both')
    with pytest.raises(DataError, match='with references in middle, the bag has none'):
        runs.read(tmp_path / 'both', 'middle')


@pytest.mark.parametrize('length', range(8))
def test_messages_with_empty_sequences_of_numbers_are_read(tmp_path, length):
    """Fast DDS reserves more bytes for these than it writes."""
    from gdmp_msgs.msg import Context, ServerState
    from rclpy.serialization import serialize_message

    from gdmp_ros.ros.recorder.record import definition
    kind, states = 'gdmp_msgs/msg/ServerState', []
    with BagWriter(tmp_path / 'bag') as bag:
        for context in (Context(), Context(names=['height'], values=[0.5])):
            states.append(ServerState(last_refusal='x' * length, context=context, steps=7))
            bag.raw('/state', kind, len(states), serialize_message(states[-1]), *definition(kind))
    with opened(tmp_path / 'bag') as reader:
        read = [message_of(reader, connection, raw) for connection, _, raw in reader.messages()]
    for one, expected in zip(read, states, strict=True):
        assert (one.last_refusal, one.steps) == (expected.last_refusal, 7)
        assert list(one.context.values) == list(expected.context.values)
        assert len(one.robot_distance) == 0


def test_messages_without_the_references_of_joints_are_read(tmp_path):
    from gdmp_msgs.msg import JointReference, Reference, RobotState
    from rclpy.serialization import serialize_message

    from gdmp_ros.ros.recorder.record import definition
    with BagWriter(tmp_path / 'run', 'mcap') as bag:
        for i in range(2):
            numbers = [1.0] * 7
            joints = [JointReference(position=numbers, velocity=numbers,
                                     stiffness=numbers)] if i else []
            state = RobotState(position=[0.1] * 7, velocity=[0.0] * 7, torque=[0.0] * 7, mode=2,
                               tick=7 + i, limited=[0.0] * 15 + [0.5] + [0.0] * 16,
                               joint_reference=joints)
            for name, kind, message in (('/a/reference', REFERENCE, Reference(mode=1,
                                                                              joints=joints)),
                                        ('/a/state', runs.STATE, state)):
                bag.raw(name, kind, 1 + i, serialize_message(message), *definition(kind))
    run = runs.read(tmp_path / 'run')
    assert run.modes.tolist() == [1, 1] and run.arm_modes.tolist() == [2, 2]
    assert run.ticks.tolist() == [7, 8] and run.limited[:, 15].tolist() == [0.5, 0.5]

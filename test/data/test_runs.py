"""Recorded runs are read from bags."""
import pytest

from gdmp_ros.data import runs
from gdmp_ros.data.bags import BagWriter, REFERENCE
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

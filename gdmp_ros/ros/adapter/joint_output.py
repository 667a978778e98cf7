"""References of the joints for a controller of joint trajectories."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gdmp_msgs.msg import JointReference
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from gdmp_ros.ros.messages import NS


class JointTrajectoryOutput:
    """
    Sends each reference as a trajectory of one point, which replaces the one before.

    The controller interpolates from where it is; the stamp 0 lets the trajectory begin at once.
    """

    def __init__(self, publisher: Any, names: Sequence[str], horizon: float):
        """:param horizon: time until the joints are to be at the point [s]"""
        self._publisher, self._names, self._horizon = publisher, list(names), horizon

    def send(self, joints: JointReference) -> None:
        """Send where the joints will be after the horizon."""
        point = JointTrajectoryPoint(
            positions=[position + self._horizon * velocity
                       for position, velocity in zip(joints.position, joints.velocity)],
            velocities=list(joints.velocity))
        ns = round(self._horizon * NS)
        point.time_from_start.sec, point.time_from_start.nanosec = ns // NS, ns % NS
        self._publisher.publish(JointTrajectory(joint_names=self._names, points=[point]))

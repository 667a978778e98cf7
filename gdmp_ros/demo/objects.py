"""A motion between a box and a hole, shown once, and executed where a camera sees them."""
from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from geometry_msgs.msg import PoseStamped, TransformStamped
import numpy as np
from tf2_msgs.msg import TFMessage

from gdmp_ros.data.bags import ns_of
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.manifolds.poses import compose, inverse, tool_manifold
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.realtime.loop import Loop, NS
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.server_client import Client
from gdmp_ros.ros.clients.testbed import NodeTestbed
from gdmp_ros.ros.middleware import best_effort
from gdmp_ros.sim.arm import Arm
from gdmp_ros.util.profiles import minimum_jerk

#: The camera sees objects at this interval, this late, with this deviation [s, s, m].
INTERVAL_S, LATENCY_S, NOISE_M = 1.0 / 30.0, 0.08, 5e-4
#: Time that is shown, and height of the arc on the way [s, m].
DURATION_S, ARC_M = 5.0, 0.08
#: The hole in the base while it is shown, and the tool above it at the end.
HOLE = np.array([0.48, 0.22, 0.2, 1.0, 0.0, 0.0, 0.0])
_ABOVE = np.array([0.0, 0.0, 0.08, 0.0, 1.0, 0.0, 0.0])
#: Time for which the tool is compared with a hole that moves [s].
_WATCHED_S = 1.0
#: Allowed distance of the tool from where the hole wants it, at rest and in motion [m]: the arm is
#: soft, 400 N/m.
AT_REST_M, MOVING_M = 0.005, 0.01


class Place(NamedTuple):
    """
    Where the hole is.

    :ivar by: from where it was shown [m]
    :ivar yaw: turned by [rad]
    :ivar velocity: with which it moves [m/s]
    """

    by: tuple[float, float, float]
    yaw: float = 0.0
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def at(self, seconds: float) -> np.ndarray:
        """Pose of the hole after a time."""
        pose = compose(HOLE, np.array([0.0, 0.0, 0.0, np.cos(0.5 * self.yaw), 0.0, 0.0,
                                       np.sin(0.5 * self.yaw)]))
        pose[:3] += np.array(self.by) + seconds * np.array(self.velocity)
        return pose


PLACES = (Place((0.0, 0.0, 0.0)), Place((-0.08, -0.1, 0.05), 0.6), Place((0.05, 0.06, 0.0), -0.7),
          Place((0.0, 0.1, 0.1), 0.3, (0.0, -0.03, 0.0)))


@cache
def home_pose(model: str = '') -> np.ndarray:
    """Pose of the tool of an arm in its home posture, where the box is."""
    arm = Arm(model)
    return arm.pose_at(arm.home)


def motion(home: np.ndarray) -> Demonstration:
    """From the home posture of the arm to above the hole."""
    times = np.arange(0.0, DURATION_S + 1e-9, 0.01)
    poses, end = tool_manifold(None), compose(HOLE, _ABOVE)
    points = np.array([poses.geodesic(home, poses.align(end, home), float(share))
                       for share in minimum_jerk(times / DURATION_S)])
    points[:, 2] += ARC_M * np.sin(np.pi * times / DURATION_S) ** 2
    return Demonstration(times, points, poses)


class Camera:
    """Sends on /tf where box and hole are, until `end`."""

    def __init__(self, client: Client, arm: ArmChoice, where: Callable[[float], np.ndarray]):
        """
        Begin.

        :param arm: beside which they are
        :param where: pose of the hole after a time [s]
        """
        self._client, self._frame, self._where = client, arm.frame, where
        self._begins = client.clock.wall()
        self._publisher = client.participant.publisher(TFMessage, '/tf', best_effort(10))
        self._box, self._random = home_pose(arm.model), np.random.default_rng(0)
        self._running = client.clock.start(self._send())

    def hole(self, stamp_ns: int) -> np.ndarray:
        """Pose of the hole at a time."""
        return self._where((stamp_ns - self._begins) / NS)

    def _send(self) -> Loop:
        clock = self._client.clock
        while True:
            stamp = clock.wall() - round(LATENCY_S * NS)
            self._publisher.publish(TFMessage(transforms=[
                self._seen(name, pose, stamp)
                for name, pose in (('box', self._box), ('hole', self.hole(stamp)))]))
            yield clock.now() + round(INTERVAL_S * NS)

    def _seen(self, name: str, pose: np.ndarray, stamp: int) -> TransformStamped:
        seen = pose.copy()
        seen[:3] += NOISE_M * self._random.standard_normal(3)
        return messages.stamped_transform(self._frame, name, seen, messages.stamp_of(stamp))

    def end(self) -> None:
        """Send nothing any more."""
        self._running.end()


def follow_objects(bed: NodeTestbed, home: Callable[[], object]) -> dict[str, Any]:
    """
    Execute the loaded skill at each of `PLACES`.

    :param home: brings the arm back before each
    :returns: for the report
    """
    tool: list[tuple[int, np.ndarray]] = []
    bed.client.subscribe(
        PoseStamped, f'{bed.arm.node}/measured_pose', lambda message: tool.append(
            (ns_of(message.header.stamp), messages.pose_numbers(message.pose))), 100)
    # Where the tool is to be, as seen from the hole.
    inside = compose(inverse(HOLE), motion(home_pose(bed.arm.model)).points[-1])
    found = []
    for place in PLACES:
        home()
        camera = Camera(bed.client, bed.arm, place.at)
        try:
            bed.spend(10.0 * INTERVAL_S)
            bed.client.execute()
            result = bed.client.result(120.0)
            bed.spend(0.5)
            tool.clear()
            bed.spend(_WATCHED_S)
            distances = np.array([pose_distance(pose, compose(camera.hole(stamp), inside))
                                  for stamp, pose in tool])
        finally:
            camera.end()
        moves = any(place.velocity)
        error = '' if result.error_code == result.SUCCESSFUL else str(result.error_string)
        far, turned = distances.max(axis=0)
        found.append({'hole_moved_by_m': list(place.by), 'hole_turned_by_rad': place.yaw,
                      'hole_speed_m_s': float(np.linalg.norm(place.velocity)), 'error': error,
                      'tool_distance_m': float(far), 'tool_angle_rad': float(turned),
                      'succeeded': not error and bool(far < (MOVING_M if moves else AT_REST_M))})
    return {'places': found, 'succeeded': all(one['succeeded'] for one in found)}

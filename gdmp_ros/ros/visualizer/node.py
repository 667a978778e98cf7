"""Node ``visualizer``: markers of server and arm for RViz, Foxglove; poses that a user drags."""
from __future__ import annotations

from collections import deque
import math
from typing import Any

from gdmp_msgs.msg import RobotState, ServerState, Tube
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
import numpy as np
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerFeedback,
    Marker,
    MarkerArray,
)

from gdmp_ros.control.manipulability import manipulability
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.lifecycle import ManagedNode, SILENT_S
from gdmp_ros.ros.messages import pose_numbers, stamped_pose
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.ros.running import run
from gdmp_ros.ros.visualizer import markers
from gdmp_ros.ros.visualizer.handles import handle, InteractiveMarkers
from gdmp_ros.ros.visualizer.objects import ObjectHandles
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.urdf import shape_pose, shapes

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('server', 'trajectory_server', 'name of the trajectory server'),
    Spec('arm', 'panda_sim', "name of the arm's node, which publishes ~/state"),
    Spec('model', '', 'model of the arm, as for panda_sim; for its shapes and its '
         'manipulability'),
    Spec('tool_site', 'tcp', 'site of the model that is controlled'),
    Spec('frame_id', 'panda_link0', "frame of the robot's base"),
    Spec('draw_arm', True, 'draw the arm as markers; no robot description and no transforms are '
         'needed then', changes='live'),
    Spec('send_goal', 'released', 'when a dragged goal is sent: once when it is released, or '
         'continuously', choices=('released', 'dragged'), changes='live'),
    Spec('objects', [''], 'task frames that are shown where /tf has them, and can be dragged; one '
         'that was dragged is published on /tf from then on, instead of by a camera'),
    Spec('path_s', 10.0, 'duration of the past path', 's', 0.1, 600.0, changes='live'),
    Spec('stiffness_scale', 1e-4, 'half-axis of the stiffness ellipsoid for each N/m', 'm^2/N',
         1e-6, 1e-2, changes='live'),
    Spec('manipulability_scale', 0.25, 'half-axis of the manipulability ellipsoid for each '
         'm^2', '1/m', 0.01, 10.0, changes='live'),
)
MENU = ('start', 'stop', 'pause', 'resume', 'guide the arm by hand', 'end hand guiding')
_GOAL, _HAND = 'goal', 'hand'


class Visualizer(ManagedNode):
    """The managed node ``visualizer``."""

    def __init__(self) -> None:
        super().__init__('visualizer')
        self.parameters = Parameters(self, SPECS)
        self._active = False

    def configure(self) -> None:
        p = self.parameters
        self._arm = Arm(p.model, p.tool_site)
        self._shapes = shapes(self._arm)
        self._past: deque[tuple[float, np.ndarray]] = deque()
        self._predicted, self._tube = np.empty((0, 3)), np.empty((0, 4, 3))
        self._shown: set[tuple[str, int]] = set()
        self._goal: np.ndarray | None = None
        self._robot: RobotState | None = None
        self._received = {'server': -math.inf, 'arm': -math.inf}
        self._markers = self.add_publisher(MarkerArray, '~/markers', 1)
        self._goal_out = self.add_publisher(PoseStamped, f'{p.server}/goal_pose', 1)
        self._hand_out = self.add_publisher(PoseStamped, f'{p.arm}/hand_pose', 1)
        self.add_subscription(ServerState, f'{p.server}/state', self.take_server)
        self.add_subscription(Path, f'{p.server}/plan', self.take_plan)
        self.add_subscription(Tube, f'{p.server}/tube', self.take_tube)
        # At 1 kHz only the newest is used.
        self._robots = self.add_subscription(RobotState, f'{p.arm}/state', None)
        kinds = {title: (Trigger, f'{p.server}/{title}') for title in ('start', 'stop')}
        kinds |= {'pause': (SetBool, f'{p.server}/pause'), 'teach': (SetBool, f'{p.arm}/teach')}
        self._calls = {title: self.add_client(kind, name) for title, (kind, name) in kinds.items()}
        self.handles = InteractiveMarkers(self, self._on_feedback)
        self._objects = ObjectHandles(self, self.handles, p.frame_id,
                                      [name for name in p.objects if name])
        self.add_report(self._show)
        self.parameters.locked = True

    def activate(self) -> None:
        self._active = True
        topic = self.resolve_topic_name('~/markers')
        self.get_logger().info(f'showing {topic}; RViz: config/gdmp.rviz')

    def deactivate(self) -> None:
        if not self._active:
            return
        self._active = False
        for name in self.handles.names():
            self.handles.remove(name)
        self._markers.publish(MarkerArray(markers=[Marker(action=Marker.DELETEALL)]))

    # Input

    def take_server(self, message: ServerState) -> None:
        """Show this state of the server from now on."""
        if not self._of_this_frame(message.header.frame_id):
            return
        goal = pose_numbers(message.goal[0]) if message.goal else None
        self._goal = goal if goal is not None and _is_pose(goal) else None
        self._received['server'] = self._now()

    def take_plan(self, message: Path) -> None:
        """Show this predicted path from now on."""
        if not self._of_this_frame(message.header.frame_id):
            return
        poses = np.array([pose_numbers(pose.pose) for pose in message.poses]).reshape(-1, 7)
        self._predicted = poses[np.isfinite(poses).all(axis=1), :3]

    def take_tube(self, message: Tube) -> None:
        """Show from now on how takes vary around the predicted path."""
        if not self._of_this_frame(message.header.frame_id):
            return
        rows = [np.vstack([pose_numbers(pose.pose)[:3],
                           np.reshape(pose.covariance, (6, 6))[:3, :3]]) for pose in message.poses]
        tube = np.array(rows).reshape(-1, 4, 3)
        self._tube = tube[np.isfinite(tube).all(axis=(1, 2))]

    def _poll(self) -> None:
        """Use the newest state of the arm."""
        message = self._robots.newest_message()
        if message is not None:
            self.take_robot(message)

    def take_robot(self, message: RobotState) -> None:
        """Show this state of the arm from now on, if it fits the model."""
        if not self._of_this_frame(message.header.frame_id):
            return
        if not (_is_pose(pose_numbers(message.pose)) and np.isfinite(message.stiffness).all()
                and np.isfinite(message.position).all()):
            return
        if len(message.position) != self._arm.model.nq:
            self.get_logger().warning(
                f'the arm has {len(message.position)} joints, the model {self._arm.model.nq}: set '
                'the parameter model', throttle_duration_sec=5.0)
            return
        self._robot = message
        self._received['arm'] = self._now()
        self._arm.reset(np.asarray(message.position))
        self._past.append((self._now(), pose_numbers(message.pose)[:3]))

    def _of_this_frame(self, frame: str) -> bool:
        target = self.parameters.frame_id
        if frame != target:
            self.get_logger().warning(f'a message is in frame {frame!r}, expected {target!r}: set '
                                      'frame_id', throttle_duration_sec=5.0)
        return bool(frame == target)

    def _now(self) -> float:
        return self.clock.now() / NS

    # Output

    def _show(self) -> None:
        if not self._active:
            return
        self._poll()
        now = self._now()
        if now - self._received['server'] > SILENT_S:
            self._goal, self._predicted = None, np.empty((0, 3))
            self._tube = np.empty((0, 4, 3))
        if now - self._received['arm'] > SILENT_S:
            self._robot = None
        oldest = now - self.parameters.path_s
        while self._past and self._past[0][0] < oldest:
            self._past.popleft()
        self._update_handles()
        self._objects.update()
        if self._markers.subscribers() == 0:
            return
        current = self._all_markers()
        stamp = self.stamp()
        for marker in current:
            marker.header.frame_id, marker.header.stamp = self.parameters.frame_id, stamp
        keys = {(marker.ns, marker.id) for marker in current}
        # Repeated: a viewer that misses a message must not keep a marker for ever.
        self._shown |= keys
        gone = [Marker(ns=space, id=number, action=Marker.DELETE)
                for space, number in sorted(self._shown - keys)]
        self._markers.publish(MarkerArray(markers=gone + current))

    def _all_markers(self) -> list[Marker]:
        p = self.parameters
        past = np.array([position for _, position in self._past]).reshape(-1, 3)
        result = [markers.line(name, positions, colour) for name, positions, colour in (
            ('past path', past, markers.PAST),
            ('predicted path', self._predicted, markers.PREDICTED)) if len(positions) > 1]
        result += markers.tube('likely positions of takes', self._tube[:, 0], self._tube[:, 1:])
        for name, pose in self._objects.poses.items():
            result += markers.frame(name, pose, 0.06)
        if self._goal is not None:
            result += markers.frame('goal', self._goal, 0.08)
        robot = self._robot
        if robot is None:
            return result
        pose = pose_numbers(robot.pose)
        stiffness = np.asarray(robot.stiffness).reshape(6, 6)[:3, :3]
        result.append(markers.ellipsoid('stiffness', pose[:3], p.stiffness_scale * stiffness,
                                        markers.STIFFNESS))
        result.append(markers.ellipsoid(
            'manipulability', pose[:3],
            p.manipulability_scale * manipulability(self._arm.measure().jacobian[:3]),
            markers.MANIPULABILITY))
        result += markers.frame('tool', pose, 0.06)
        result += markers.frame('base', np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]), 0.1)
        if p.draw_arm:
            result += markers.body('arm', self._shapes,
                                   [shape_pose(self._arm, shape) for shape in self._shapes])
        return result

    # Interactive markers

    def _update_handles(self) -> None:
        """Move the handle of the goal to the goal, and that of the hand to the tool."""
        tool = None if self._robot is None else pose_numbers(self._robot.pose)
        for name, where in ((_GOAL, self._goal), (_HAND, tool)):
            if where is None:
                self.handles.remove(name)
            elif name not in self.handles.names():
                self.handles.put(self._handle(name))
            if where is not None:
                self.handles.move(name, where)
        if self.handles.dragged(_HAND):
            # Repeated, because the arm counts a silent hand as released.
            self._send(self._hand_out, self.handles.pose(_HAND))

    def _handle(self, name: str) -> InteractiveMarker:
        frame = self.parameters.frame_id
        if name == _GOAL:
            return handle(_GOAL, 'goal', frame, 0.2, [markers.sphere(markers.GOAL, 0.02)], MENU)
        return handle(_HAND, 'hand (teaching)', frame, 0.12, [markers.sphere(markers.PAST, 0.015)])

    def _on_feedback(self, message: InteractiveMarkerFeedback) -> None:
        kind = InteractiveMarkerFeedback
        if not self._active:
            return
        if message.event_type == kind.MENU_SELECT:
            self._call(message.menu_entry_id)
        elif message.marker_name == _HAND and message.event_type == kind.POSE_UPDATE:
            self._send(self._hand_out, self.handles.pose(_HAND))
        elif message.marker_name == _GOAL and message.event_type == (
                kind.MOUSE_UP if self.parameters.send_goal == 'released' else kind.POSE_UPDATE):
            self._send(self._goal_out, self.handles.pose(_GOAL))
        else:
            self._objects.drag(message)

    def _send(self, publisher: Any, pose: np.ndarray) -> None:
        publisher.publish(stamped_pose(pose, self.parameters.frame_id, self.stamp()))

    def _call(self, entry: int) -> None:
        """Call the service of a menu entry; a refusal is logged."""
        if not 1 <= entry <= len(MENU):
            return
        title = MENU[entry - 1]
        which, value = {'resume': ('pause', False), 'pause': ('pause', True),
                        'guide the arm by hand': ('teach', True),
                        'end hand guiding': ('teach', False)}.get(title, (title, None))
        client = self._calls[which]
        if not client.service_is_ready():
            self.get_logger().warning(f'{title}: the service {client.srv_name} is not '
                                      'available')
            return
        request = client.srv_type.Request()
        if value is not None:
            request.data = value
        client.call_async(request).add_done_callback(
            lambda future: self._answered(title, future.result()))

    def _answered(self, title: str, reply: Any) -> None:
        if reply is not None and not reply.success:
            self.get_logger().warning(f'{title} was refused: {reply.message}')


def _is_pose(numbers: np.ndarray) -> bool:
    """Whether numbers are a valid pose."""
    return bool(np.isfinite(numbers).all() and abs(np.linalg.norm(numbers[3:]) - 1.0) < 0.01)


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``visualizer``."""
    return run([Visualizer], arguments)


if __name__ == '__main__':
    raise SystemExit(main())

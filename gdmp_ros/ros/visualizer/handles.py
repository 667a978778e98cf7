"""Interactive markers: poses that a user drags in RViz or Foxglove."""
from __future__ import annotations

from collections.abc import Callable, Sequence
import math

from geometry_msgs.msg import Quaternion
import numpy as np
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
    InteractiveMarkerPose,
    InteractiveMarkerUpdate,
    Marker,
    MenuEntry,
)
from visualization_msgs.srv import GetInteractiveMarkers

from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import pose_numbers, set_pose

#: History of updates and feedback; dragging causes feedback with every frame of the display.
DEPTH = 100
#: Without feedback for this time a marker counts as released; RViz repeats it at 4 Hz [s].
RELEASE_S = 1.0
#: A released marker stays for this time, until the request has an effect [s].
STAY_S = 0.5
_AXES = {'x': (1.0, 0.0, 0.0), 'y': (0.0, 1.0, 0.0), 'z': (0.0, 0.0, 1.0)}


def handle(name: str, description: str, frame: str, scale: float, shapes: Sequence[Marker],
           menu: Sequence[str] = ()) -> InteractiveMarker:
    """
    Make a marker that is moved and rotated along its axes.

    :param shapes: with poses relative to the marker
    :param menu: titles; their ids begin with 1
    """
    result = InteractiveMarker(name=name, description=description, scale=scale)
    result.header.frame_id = frame
    for axis, direction in _AXES.items():
        half = math.sqrt(0.5)
        orientation = Quaternion(w=half, **{a: half * d for a, d in zip('xyz', direction)})
        for mode, what in ((InteractiveMarkerControl.MOVE_AXIS, 'move'),
                           (InteractiveMarkerControl.ROTATE_AXIS, 'turn')):
            result.controls.append(InteractiveMarkerControl(
                name=f'{what}_{axis}', orientation=orientation, interaction_mode=mode))
    result.controls.append(InteractiveMarkerControl(
        name='body', always_visible=True, markers=list(shapes),
        interaction_mode=(InteractiveMarkerControl.MENU if menu
                          else InteractiveMarkerControl.MOVE_3D)))
    result.menu_entries = [MenuEntry(id=i, title=title, command_type=MenuEntry.FEEDBACK)
                           for i, title in enumerate(menu, 1)]
    return result


class InteractiveMarkers:
    """Serves the markers of a node, and calls back on feedback."""

    def __init__(self, node: ManagedNode,
                 on_feedback: Callable[[InteractiveMarkerFeedback], None]):
        """:param on_feedback: receives feedback about a marker"""
        self._clock = node.clock
        self._markers: dict[str, InteractiveMarker] = {}
        self._on_feedback = on_feedback
        self._sequence = 0
        self._dragged: dict[str, float] = {}
        self._released: dict[str, float] = {}
        self._update = node.add_publisher(InteractiveMarkerUpdate, '~/update', DEPTH)
        node.add_subscription(InteractiveMarkerFeedback, '~/feedback', self.take_feedback, DEPTH)
        node.add_service(GetInteractiveMarkers, 'get_interactive_markers', self._on_get)
        self._name = node.get_fully_qualified_name()

    def put(self, marker: InteractiveMarker) -> None:
        """Add a marker, or replace the one of the same name."""
        self._markers[marker.name] = marker
        self._send(markers=[marker])

    def remove(self, name: str) -> None:
        """Remove a marker, if it exists."""
        if self._markers.pop(name, None) is not None:
            self._dragged.pop(name, None)
            self._send(erases=[name])

    def names(self) -> set[str]:
        """Names of all markers."""
        return set(self._markers)

    def dragged(self, name: str) -> bool:
        """Whether a user drags a marker."""
        return self._now() - self._dragged.get(name, -math.inf) < RELEASE_S

    def _now(self) -> float:
        return self._clock.now() / NS

    def pose(self, name: str) -> np.ndarray:
        """Pose of a marker (x, y, z, qw, qx, qy, qz)."""
        return pose_numbers(self._markers[name].pose)

    def move(self, name: str, pose: np.ndarray) -> None:
        """Move a marker, unless a user drags it or has just released it."""
        released = self._now() - self._released.get(name, -math.inf) < STAY_S
        if self.dragged(name) or released or np.allclose(pose, self.pose(name), atol=1e-9):
            return
        marker = self._markers[name]
        set_pose(marker.pose, pose)
        self._send(poses=[InteractiveMarkerPose(header=marker.header, pose=marker.pose,
                                                name=name)])

    def _send(self, **changes: object) -> None:
        self._sequence += 1
        self._update.publish(InteractiveMarkerUpdate(
            server_id=self._name, seq_num=self._sequence, type=InteractiveMarkerUpdate.UPDATE,
            **changes))

    def _on_get(self, _: GetInteractiveMarkers.Request,
                reply: GetInteractiveMarkers.Response) -> GetInteractiveMarkers.Response:
        reply.sequence_number, reply.markers = self._sequence, list(self._markers.values())
        return reply

    def take_feedback(self, message: InteractiveMarkerFeedback) -> None:
        """Use feedback about a marker; other messages are ignored."""
        marker = self._markers.get(message.marker_name)
        if marker is None or message.header.frame_id != marker.header.frame_id:
            return
        numbers = pose_numbers(message.pose)
        if not np.isfinite(numbers).all():
            return
        kind = InteractiveMarkerFeedback
        if message.event_type in (kind.MOUSE_DOWN, kind.POSE_UPDATE, kind.KEEP_ALIVE):
            self._dragged[message.marker_name] = self._now()
        if message.event_type in (kind.POSE_UPDATE, kind.MOUSE_UP):
            marker.pose = message.pose
        if message.event_type == kind.MOUSE_UP:
            self._dragged.pop(message.marker_name, None)
            self._released[message.marker_name] = self._now()
        self._on_feedback(message)

"""Pick and place through three objects; one of them is pushed into the way meanwhile."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
from gdmp_msgs.msg import GripperState
import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from gdmp_ros.demo.recorded import RecordedWorld
from gdmp_ros.realtime.loop import Loop, NS
from gdmp_ros.ros.clients.testbed import NodeTestbed
from gdmp_ros.ros.scene.messages import markers_of
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.gripper import add_gripper
from gdmp_ros.sim.replay import Replay
from gdmp_ros.sim.scenes import CLUTTER, CUBE_EDGE, pick_and_place, PUSHED
from gdmp_ros.sim.tool_shape import tool_frames
from gdmp_ros.sim.volumes import add_volumes, VolumeBodies
from gdmp_ros.util.profiles import minimum_jerk

#: When it is pushed, as progress of the motion, by how much [m], and how long that takes [s].
PUSH_AT, PUSH_BY, PUSH_S = 0.42, np.array([0.07, 0.0, 0.0]), 1.2
#: Stiffness of the tool: a softer arm swings further into the margin [N/m].
STIFFNESS = [1000.0, 1000.0, 1000.0]
#: Parameter of arm and server.
MARGIN = {'scene_margin': CLUTTER.margin}
#: The scene is told at this interval [s].
INTERVAL_S = 1.0 / 30.0
#: Time between two pictures of the film, and two distances that are measured [s].
PICTURE_S, DISTANCE_S = 0.1, 0.005


class Clutter:
    """Tells the arm where the objects are, and that it carries the cube."""

    def __init__(self, bed: NodeTestbed):
        """Begin to tell."""
        self._client, self._frame = bed.client, bed.arm.frame
        self._tool = next(iter(tool_frames(Arm(bed.arm.model), bed.arm.frame).items()))
        self._topic = bed.client.publisher(MarkerArray, f'{bed.arm.node}/scene', 10)
        self._pushed_at: int | None = None
        self._holding = False
        bed.client.subscribe(GripperState, 'gripper/state', self._on_gripper, 100)
        self._running = bed.client.clock.start(self._tell())

    def push(self) -> None:
        """Begin to push the object that is pushed."""
        self._pushed_at = self._client.clock.now()

    def end(self) -> None:
        """Tell nothing any more."""
        self._running.end()

    def _on_gripper(self, message: GripperState) -> None:
        self._holding = message.holding

    def _tell(self) -> Loop:
        clock = self._client.clock
        while True:
            now, scene = clock.now(), Scene(list(CLUTTER), CLUTTER.margin)
            if self._pushed_at is not None:
                share = float(minimum_jerk(np.array(
                    [min((now - self._pushed_at) / NS / PUSH_S, 1.0)]))[0])
                volume = CLUTTER[PUSHED]
                pose = volume.pose.copy()
                pose[:3] += share * PUSH_BY
                scene.put(volume.at(pose))
            stamp = clock.wall()
            message = markers_of(scene, self._frame, Time(sec=stamp // NS, nanosec=stamp % NS))
            message.markers.append(self._cube())
            self._topic.publish(message)
            yield now + round(INTERVAL_S * NS)

    def _cube(self) -> Marker:
        """What the gripper holds is at the tool point, and moves with it."""
        marker = Marker(type=Marker.CUBE, text='cube', frame_locked=True,
                        action=Marker.ADD if self._holding else Marker.DELETE)
        marker.header.frame_id, in_tool = self._tool
        place = marker.pose.position
        place.x, place.y, place.z = (-in_tool[:3]).tolist()
        marker.scale.x = marker.scale.y = marker.scale.z = CUBE_EDGE
        return marker


def world(model: str = '') -> Arm:
    """The arm with everything around it; the objects have joints of their names."""
    return Arm(model, extras=[add_gripper, pick_and_place, add_volumes(CLUTTER, free=True)])


def clearance(recorded: RecordedWorld, arm: Arm) -> dict[str, Any]:
    """
    How near links and fingers came to the objects, and how often they touched one.

    :param arm: `world`
    """
    replay, bodies, least, contacts = Replay(arm), VolumeBodies(arm, CLUTTER), np.inf, 0
    for stamp in recorded.stamps(DISTANCE_S):
        replay.show(recorded.posture(int(stamp)), recorded.places(int(stamp)))
        least = min(least, bodies.least())
        contacts += bool(bodies.contacts())
    return {'least_m': float(least), 'margin_m': CLUTTER.margin, 'contacts': contacts}


def execute(bed: NodeTestbed, task: Callable[[Clutter], dict[str, Any]]) -> dict[str, Any]:
    """
    Execute the pick among the objects.

    :param task: starts the nodes, executes it, records it, and pushes on its way
    """
    clutter = Clutter(bed)
    try:
        document = task(clutter)
    finally:
        clutter.end()
    bed.end_recording()
    recorded, arm = RecordedWorld(bed.folder / 'run', ('cube',)), world(bed.arm.model)
    document['clearance'] = clearance(recorded, arm)
    document['succeeded'] = bool(document['succeeded'] and not document['clearance']['contacts'])
    recorded.film(bed.folder / 'film.webp', Replay(arm), PICTURE_S)
    return document

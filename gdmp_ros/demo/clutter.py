"""Pick and place through three objects; one of them is pushed into the way meanwhile."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from builtin_interfaces.msg import Time
from gdmp_msgs.msg import GripperState
import numpy as np
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from gdmp_ros.data.bags import ns_of
from gdmp_ros.data.runs import Run
from gdmp_ros.realtime.loop import Loop, NS
from gdmp_ros.ros.clients.testbed import NodeTestbed
from gdmp_ros.ros.messages import transform_numbers
from gdmp_ros.ros.scene.messages import markers_of
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.gripper import add_gripper, FINGERS
from gdmp_ros.sim.replay import Replay
from gdmp_ros.sim.scenes import CLUTTER, CUBE_EDGE, pick_and_place, PUSHED
from gdmp_ros.sim.tool_shape import tool_frames
from gdmp_ros.sim.volumes import add_volumes, VolumeBodies
from gdmp_ros.util.profiles import minimum_jerk
from gdmp_ros.view.films import render_to

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
    """
    Tells the arm where the objects are, and that it carries the cube.

    :ivar told: time [ns] and scene of each time that it was told
    :ivar cubes: time [ns] and pose of the cube, where it is simulated
    :ivar widths: time [ns] and width of the gripper [m]
    """

    def __init__(self, bed: NodeTestbed):
        """Begin to tell."""
        self._client, self._frame = bed.client, bed.arm.frame
        self._tool = next(iter(tool_frames(Arm(bed.arm.model), bed.arm.frame).items()))
        self._topic = bed.client.publisher(MarkerArray, f'{bed.arm.node}/scene', 10)
        self._pushed_at: int | None = None
        self.told: list[tuple[int, Scene]] = []
        self.cubes: list[tuple[int, np.ndarray]] = []
        self.widths: list[tuple[int, float]] = []
        self._holding = False
        bed.client.subscribe(GripperState, 'gripper/state', self._on_gripper, 100)
        bed.client.subscribe(TFMessage, '/tf', self._on_frames, 100)
        self._running = bed.client.clock.start(self._tell())

    def push(self) -> None:
        """Begin to push the object that is pushed."""
        self._pushed_at = self._client.clock.now()

    def end(self) -> None:
        """Tell nothing any more."""
        self._running.end()

    def _on_gripper(self, message: GripperState) -> None:
        self._holding = message.holding
        self.widths.append((self._client.clock.wall(), message.width))

    def _on_frames(self, message: TFMessage) -> None:
        self.cubes += [(ns_of(one.header.stamp), transform_numbers(one.transform))
                       for one in message.transforms if one.child_frame_id == 'cube']

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
            self.told.append((stamp, scene))
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


class Recorded:
    """What a run looked like: the arm, the cube and the objects at any time of it."""

    def __init__(self, run: Run, clutter: Clutter, model: str):
        """:param model: of the arm; empty: the built-in Panda"""
        self._run, self._clutter = run, clutter
        arm = Arm(model, extras=[add_gripper, pick_and_place, add_volumes(CLUTTER, free=True)])
        self._replay, self._bodies = Replay(arm), VolumeBodies(arm, CLUTTER)

    def show(self, stamp: int) -> np.ndarray:
        """Put everything where it was at a time [ns]; all positions."""
        run, clutter = self._run, self._clutter
        width, cube, scene = (_last(rows, stamp) for rows in (
            clutter.widths, clutter.cubes, clutter.told))
        places = {volume.name: volume.pose for volume in scene or ()}
        if width is not None:
            places.update(dict.fromkeys(FINGERS, 0.5 * width))
        if cube is not None:
            places['cube'] = cube
        return self._replay.show(
            run.joints[max(int(np.searchsorted(run.state_stamps, stamp)) - 1, 0)], places)

    def _stamps(self, every: float) -> np.ndarray:
        return np.arange(self._run.state_stamps[0], self._run.state_stamps[-1],
                         round(every * NS))

    def clearance(self) -> dict[str, Any]:
        """How near links and fingers came to the objects, and how often they touched one."""
        least, contacts = np.inf, 0
        for stamp in self._stamps(DISTANCE_S):
            self.show(int(stamp))
            least = min(least, self._bodies.least())
            contacts += bool(self._bodies.contacts())
        return {'least_m': float(least), 'margin_m': CLUTTER.margin, 'contacts': contacts}

    def film(self, target: Path) -> None:
        """Write a film."""
        print(f'drawing {target}', flush=True)
        rows = np.array([self.show(int(stamp)) for stamp in self._stamps(PICTURE_S)])
        world = target.with_suffix('.mjb')
        self._replay.save(world)
        try:
            missing = render_to(target, rows, self._run.poses[::100, :3], world, PICTURE_S,
                                whole=True)
        finally:
            world.unlink()
        if missing:
            print(missing)


def _last(rows: list[tuple[int, Any]], stamp: int) -> Any:
    """The value of the last row before a time; None without a row."""
    if not rows:
        return None
    at = int(np.searchsorted([when for when, _ in rows], stamp))
    return rows[max(at - 1, 0)][1]


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
    recorded = Recorded(bed.recorded(), clutter, bed.arm.model)
    document['clearance'] = recorded.clearance()
    document['succeeded'] = bool(document['succeeded'] and not document['clearance']['contacts'])
    recorded.film(bed.folder / 'film.webp')
    return document

"""Pick and place through three objects; one of them is pushed into the way meanwhile."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

from builtin_interfaces.msg import Time
import numpy as np
from visualization_msgs.msg import MarkerArray

from gdmp_ros.control.surroundings import depths
from gdmp_ros.data.runs import Run
from gdmp_ros.realtime.loop import Loop, NS
from gdmp_ros.ros.clients.testbed import NodeTestbed, SERVER
from gdmp_ros.ros.scene.messages import markers_of
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.scenes import CLUTTER, PUSHED
from gdmp_ros.util.profiles import minimum_jerk

#: When it is pushed, as progress of the motion, by how much [m], and how long that takes [s].
PUSH_AT, PUSH_BY, PUSH_S = 0.42, np.array([0.07, 0.0, 0.0]), 1.2
#: Stiffness of the tool: a softer arm swings further into the margin [N/m].
STIFFNESS = [1000.0, 1000.0, 1000.0]
#: Parameter of arm and server.
MARGIN = {'scene_margin': CLUTTER.margin}
#: The scene is told at this interval [s].
INTERVAL_S = 1.0 / 30.0


class Clutter:
    """
    Tells arm and server where the objects are.

    :ivar told: time [ns] and scene of each time that they were told
    """

    def __init__(self, bed: NodeTestbed):
        """Begin to tell."""
        self._client, self._frame = bed.client, bed.arm.frame
        self._topics = [bed.client.publisher(MarkerArray, f'{node}/scene', 10)
                        for node in (SERVER, bed.arm.node)]
        self._pushed_at: int | None = None
        self.told: list[tuple[int, Scene]] = []
        self._running = bed.client.clock.start(self._tell())

    def push(self) -> None:
        """Begin to push the object that is pushed."""
        self._pushed_at = self._client.clock.now()

    def end(self) -> None:
        """Tell nothing any more."""
        self._running.end()

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
            for topic in self._topics:
                topic.publish(message)
            yield now + round(INTERVAL_S * NS)


def clearance(run: Run, told: list[tuple[int, Scene]], arm: Arm) -> dict[str, Any]:
    """
    How near the links came to the objects, from the measured joints.

    :param told: see `Clutter`
    """
    stamps, shape = np.array([stamp for stamp, _ in told]), arm.shape
    packed = [scene.packed(shape.bits) for _, scene in told]
    margin, least, contacts = CLUTTER.margin, np.inf, 0
    for stamp, joints in zip(run.state_stamps[::5], run.joints[::5]):
        rows = packed[max(int(np.searchsorted(stamps, stamp)) - 1, 0)]
        left = margin - float(depths(arm.chain, shape, joints, rows).max())
        least, contacts = min(least, left), contacts + (left <= 0.0)
    return {'least_m': least, 'margin_m': margin, 'contacts': contacts}


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
    run = bed.recorded()
    document['clearance'] = clearance(run, clutter.told, Arm(bed.arm.model))
    document['succeeded'] = bool(document['succeeded'] and not document['clearance']['contacts'])
    return document

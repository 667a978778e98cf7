"""What a bag shows: the arm, its gripper and goal, objects on /tf, and its surroundings."""
from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.data import bags
from gdmp_ros.data.runs import STATE
from gdmp_ros.errors import DataError
from gdmp_ros.realtime.loop import NS
from gdmp_ros.sim.gripper import FINGERS
from gdmp_ros.sim.replay import Replay
from gdmp_ros.view.films import render_to

_TF, _GRIPPER, _SCENE, _SERVER = (
    'tf2_msgs/msg/TFMessage', 'gdmp_msgs/msg/GripperState', 'gdmp_msgs/msg/Scene',
    'gdmp_msgs/msg/ServerState')


#: What is recorded too, as arguments of `gdmp_ros.ros.recorder.record`.
TRANSFORMS, GRIPPER = f'/tf={_TF}', f'/gripper/state={_GRIPPER}'


def surroundings(node: str) -> list[str]:
    """What an arm keeps away from, as `TRANSFORMS`; it is published when it changes."""
    topic = f'/{node}/surroundings'
    return ['--lasting', topic, f'{topic}={_SCENE}']


class RecordedWorld:
    """
    Where arm and objects were.

    :ivar state_stamps: [ns]
    :ivar postures: of the arm at these times [rad], shape (T, n)
    :ivar positions: of its tool [m], shape (T, 3)
    """

    def __init__(self, bag: Path, objects: Sequence[str] = ()):
        """
        Read a bag.

        :param objects: frames on /tf
        :raises DataError: if it has no states of an arm
        """
        self._rows: dict[str, list[tuple[int, Any]]] = {}
        states = []
        kinds = _TF, _GRIPPER, _SCENE, _SERVER, STATE
        with bags.opened(bag) as reader:
            used = [one for one in reader.connections if one.msgtype in kinds]
            for connection, bag_time, raw in reader.messages(used):
                message = bags.message_of(reader, connection, raw)
                if connection.msgtype == STATE:
                    pose = bags.pose_numbers(message.pose)
                    states.append((bags.ns_of(message.header.stamp), message.position, pose[:3]))
                if connection.msgtype == _GRIPPER:
                    for finger in FINGERS:
                        self._note(finger, bag_time, 0.5 * message.width)
                if connection.msgtype == _SERVER and len(message.goal):
                    self._note('goal', bag_time, np.array(bags.pose_numbers(message.goal[0])))
                for one in message.volumes if connection.msgtype == _SCENE else ():
                    if not one.carried:
                        self._note(one.name, bag_time, np.array(bags.pose_numbers(one.pose)))
                for one in message.transforms if connection.msgtype == _TF else ():
                    if one.child_frame_id in objects:
                        self._note(one.child_frame_id, bags.ns_of(one.header.stamp), np.array(
                            bags.transform_numbers(one.transform)))
        if not states:
            raise DataError(f'{bag}: no states of an arm')
        self.state_stamps, self.postures, self.positions = (
            np.array(column) for column in zip(*states))

    def _note(self, name: str, stamp: int, value: Any) -> None:
        self._rows.setdefault(name, []).append((stamp, value))

    def posture(self, stamp: int) -> np.ndarray:
        """Positions of the joints at a time [rad]."""
        at = int(np.searchsorted(self.state_stamps, stamp)) - 1
        return np.asarray(self.postures[max(at, 0)])

    def places(self, stamp: int) -> Mapping[str, Any]:
        """Where fingers, objects and volumes were at a time, by their names."""
        return {name: rows[max(bisect_right(rows, stamp, key=lambda row: row[0]) - 1, 0)][1]
                for name, rows in self._rows.items()}

    def stamps(self, every: float) -> np.ndarray:
        """Times of the run at an interval [s]."""
        return np.arange(self.state_stamps[0], self.state_stamps[-1], round(every * NS))

    def film(self, target: Path, replay: Replay, every: float, stamps: np.ndarray | None = None,
             caption: str = '') -> None:
        """
        Write a film.

        :param replay: of an arm with the objects that are to be seen
        :param every: time between two pictures [s]
        :param stamps: of the pictures [ns]; by default all of the bag, at this interval
        :param caption: below the pictures
        """
        print(f'drawing {target}', flush=True)
        stamps = self.stamps(every) if stamps is None else stamps
        rows = np.array([replay.show(self.posture(int(stamp)), self.places(int(stamp)))
                         for stamp in stamps])
        inside = (self.state_stamps >= stamps[0]) & (self.state_stamps <= stamps[-1])
        world = target.with_suffix('.mjb')
        replay.save(world)
        try:
            missing = render_to(target, rows, self.positions[inside][::100], world, every,
                                whole=True, caption=caption)
        finally:
            world.unlink()
        if missing:
            print(missing)

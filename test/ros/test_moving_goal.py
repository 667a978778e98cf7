"""A goal on a belt, through the node and on the simulated arm."""
import random

from gdmp_msgs.msg import MovingGoal
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest

from gdmp_ros.data.bags import reference_target
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import SERVER
from test.ros.nodes import FRAME

NS = 1_000_000_000
SPEED, SECONDS = 0.1, 5.0


class Belt:
    """
    Sends a goal that moves along y, from a pose on.

    :ivar sent: times of what was sent [ns]
    """

    def __init__(self, running, given, begin):
        """:param given: messages with a twist; else poses at 30 Hz with jitter and losses"""
        self.sent, self._begin, self._given = [], begin, given
        self._kind = MovingGoal if given else PoseStamped
        self._clock = running.client.clock
        self._publisher = running.publisher(
            self._kind, f'{SERVER}/{"moving_goal" if given else "goal_pose"}')
        self.running = self._clock.start(self._send())

    def where(self, stamp):
        """Pose of the goal at a time."""
        away = SPEED * (stamp - self.sent[0]) / NS
        return self._begin + [0.0, away, 0.0, 0.0, 0.0, 0.0, 0.0]

    def _send(self):
        choose, clock, ends = random.Random(1), self._clock, self._clock.now() + SECONDS * NS
        while clock.now() < ends:
            stamp = clock.wall()
            self.sent.append(stamp)
            message = self._kind()
            message.header.frame_id, message.header.stamp = FRAME, messages.stamp_of(stamp)
            messages.set_pose(message.pose, self.where(stamp))
            if self._given:
                message.twist.linear.y = SPEED
            # Jitter of 5 ms, and one in five is lost.
            yield clock.now() + round(0.005 * choose.random() * NS)
            self._publisher.publish(message)
            if self._given:
                yield clock.now() + round(0.5 * NS)
                continue
            yield clock.now() + round(0.033 * NS)
            while choose.random() < 0.2:
                yield clock.now() + round(0.033 * NS)


@pytest.mark.parametrize('given', [False, True], ids=['estimated', 'given'])
def test_the_arm_follows_a_goal_on_a_belt(running, skill, given):
    """30 Hz with 5 ms of jitter and 20 % of the messages lost; or a twist twice a second."""
    running.listen()
    running.client.execute()
    running.wait_progress(0.1)
    belt = Belt(running, given, skill.goal[:7] - [0.0, 0.5 * SPEED * SECONDS, 0, 0, 0, 0, 0])
    running.spend(SECONDS + 0.2)
    first = belt.sent[0]
    last = belt.sent[-1]

    def selected(received):
        stamps = np.array([m.header.stamp.sec * NS + m.header.stamp.nanosec for m in received])
        chosen = (stamps > first + 0.7 * SECONDS * NS) & (stamps < last)
        assert chosen.sum() > 200
        return ([m for m, one in zip(received, chosen) if one],
                np.array([belt.where(stamp)[:3] for stamp in stamps[chosen]]))

    references, goals = selected(running.references)
    shown = np.array([reference_target(m) for m in references])
    assert np.linalg.norm(shown[:, :3] - goals, axis=1).max() <= 1e-3
    assert np.abs(np.diff(shown[:, 13:16], axis=0)).max() <= 0.02
    # The motion has finished although the goal moves on, and the arm follows too.
    result = running.client.result(1.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    states, goals = selected(running.robot)
    away = np.array([messages.pose_numbers(m.pose)[:3] for m in states]) - goals
    assert np.linalg.norm(away[:, [0, 2]], axis=1).max() < 0.01
    assert np.abs(away[:, 1]).max() < 0.03
    if not given:
        # The poses have ended: the arm comes to rest where the last one was.
        running.wait('rest', lambda: abs(running.robot[-1].twist.linear.y) < 0.005)

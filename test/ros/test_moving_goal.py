"""A goal on a belt, through the node and on the simulated arm."""
import time

from gdmp_msgs.msg import MovingGoal
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest

from gdmp_ros.ros import messages
from gdmp_ros.ros.testbed import SERVER
from test.ros.nodes import FRAME

SPEED, SECONDS = 0.1, 5.0
NS = 1_000_000_000


@pytest.mark.parametrize('given', [False, True], ids=['estimated', 'given'])
def test_the_arm_follows_a_goal_on_a_belt(running, skill, given, rng):
    """30 Hz with 5 ms of jitter and 20 % of the messages lost; or one message with a twist."""
    running.listen()
    kind = MovingGoal if given else PoseStamped
    publisher = running.publisher(kind, f'{SERVER}/{"moving_goal" if given else "goal_pose"}')
    running.client.execute()
    running.wait_progress(0.2)
    sent = []
    begin, first = skill.goal[:7] - [0.0, 0.5 * SPEED * SECONDS, 0, 0, 0, 0, 0], time.time_ns()

    def where(ns):
        return begin + SPEED * (ns - first) / NS * np.array([0.0, 1.0, 0, 0, 0, 0, 0])

    def show():
        message, stamp = kind(), time.time_ns()
        message.header.frame_id, message.header.stamp = FRAME, messages.stamp_of(stamp)
        messages.set_pose(message.pose, where(stamp))
        if given:
            message.twist.linear.y = SPEED
        running.spend(0.005 * rng.random())
        publisher.publish(message)
        sent.append(time.time_ns())
    show()
    while time.time_ns() < first + SECONDS * NS:
        if not given and rng.random() >= 0.2:
            show()
        running.spend(0.033)
    stamps = np.array([m.header.stamp.sec * NS + m.header.stamp.nanosec
                       for m in running.references])
    # Up to the first time for which this process, which sends the goals, was held up itself.
    gaps = [one for one, other in zip(sent, sent[1:]) if other - one > 0.35 * NS]
    last = first + SECONDS * NS if given or not gaps else gaps[0]
    followed = (stamps > first + 0.7 * SECONDS * NS) & (stamps < last)
    assert followed.sum() > 200, 'this machine is too busy to send goals'
    shown = np.array([messages.reference_target(m) for m in running.references])
    lag = shown[followed, :3] - np.array([where(stamp)[:3] for stamp in stamps[followed]])
    assert np.linalg.norm(lag, axis=1).max() <= 1e-3
    assert np.abs(np.diff(shown[followed, 13:16], axis=0)).max() <= 0.02
    # The motion has finished although the goal moves on, and the arm follows too.
    result = running.client.result(1.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    away = running.tool()[:3] - where(time.time_ns())[:3]
    assert np.linalg.norm(away[[0, 2]]) < 0.01 and abs(away[1]) < 0.03
    if not given:
        # The poses have ended: the arm comes to rest where the last one was.
        running.wait('rest', lambda: np.linalg.norm(
            np.array([running.robot[-1].twist.linear.y])) < 0.005)

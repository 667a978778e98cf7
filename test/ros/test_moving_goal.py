"""A goal on a belt, through the node and on the simulated arm."""
import numpy as np
import pytest

from gdmp_ros.data.message_numbers import reference_target
from gdmp_ros.ros import messages
from gdmp_ros.ros.testbed import SERVER
from test.ros.belt import NS, where

SPEED, SECONDS = 0.1, 5.0


@pytest.mark.parametrize('given', [False, True], ids=['estimated', 'given'])
def test_the_arm_follows_a_goal_on_a_belt(running, skill, given):
    """30 Hz with 5 ms of jitter and 20 % of the messages lost; or one message with a twist."""
    running.listen()
    begin = skill.goal[:7] - [0.0, 0.5 * SPEED * SECONDS, 0, 0, 0, 0, 0]
    running.client.execute()
    running.wait_progress(0.1)
    belt = 'twist' if given else 'pose'
    running.children.start(belt, 'test.ros.belt', [
        f'{SERVER}/{"moving_goal" if given else "goal_pose"}', belt,
        str(SPEED), str(SECONDS), *map(str, begin)])
    try:
        running.wait_log(belt, 'end\n', 30.0)
        sent = [int(line) for line in running.log(belt).split() if line.isdigit()]
    finally:
        running.children.kill(belt)
    first = sent[0]
    last = int(first + SECONDS * NS) if given else sent[-1]
    gap = np.diff(sent).max(initial=0) / NS
    assert gap < 0.35, f'this machine is too busy to send goals: {gap:.2f} s between two'

    def selected(received):
        stamps = np.array([m.header.stamp.sec * NS + m.header.stamp.nanosec for m in received])
        chosen = (stamps > first + 0.7 * SECONDS * NS) & (stamps < last)
        assert chosen.sum() > 200
        return ([m for m, one in zip(received, chosen) if one],
                np.array([where(begin, SPEED, stamp - first)[:3] for stamp in stamps[chosen]]),
                stamps[chosen])

    references, goals, stamps = selected(running.references)
    shown = np.array([reference_target(m) for m in references])
    assert np.linalg.norm(shown[:, :3] - goals, axis=1).max() <= 1e-3
    # Of each millisecond: a tick that is missed makes one change of two.
    milliseconds = np.maximum(np.diff(stamps) / 1e6, 1.0)[:, None]
    assert np.abs(np.diff(shown[:, 13:16], axis=0) / milliseconds).max() <= 0.02
    # The motion has finished although the goal moves on, and the arm follows too.
    result = running.client.result(1.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    states, goals, _ = selected(running.robot)
    away = np.array([messages.pose_numbers(m.pose)[:3] for m in states]) - goals
    assert np.linalg.norm(away[:, [0, 2]], axis=1).max() < 0.01
    assert np.abs(away[:, 1]).max() < 0.03
    if not given:
        # The poses have ended: the arm comes to rest where the last one was.
        running.wait('rest', lambda: abs(running.robot[-1].twist.linear.y) < 0.005)

"""When a robot counts as being at rest."""
import numpy as np
import pytest

from gdmp_ros.playback.robot_watch import REST_S, RobotSettings, RobotWatch, STILL_M

POSE = np.array([0.4, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize('spacing', [0.001, 0.05, 0.0505, 0.07, 0.11, 0.25])
def test_a_still_robot_rests_however_often_it_is_measured(spacing):
    """A tick that is missed now and then lengthens the time between two measurements."""
    watch, now = RobotWatch(RobotSettings()), 0.0
    while now < REST_S - 1e-6:
        watch.update(now, POSE, POSE, False)
        assert not watch.rests(), now
        now += spacing
    for _ in range(10):
        watch.update(now, POSE, POSE, False)
        assert watch.rests(), now
        now += spacing


def test_a_robot_that_moves_does_not_rest_until_it_has_been_still():
    watch = RobotWatch(RobotSettings())
    for k in range(100):
        watch.update(0.01 * k, POSE + [0.02 * 0.01 * k, 0, 0, 0, 0, 0, 0], POSE, True)
    assert not watch.rests()
    stopped = watch.place + [STILL_M, 0, 0, 0, 0, 0, 0]
    seconds = next(0.01 * k for k in range(100)
                   if watch.update(1.0 + 0.01 * k, stopped, POSE, True) or watch.rests())
    assert seconds == pytest.approx(REST_S, abs=0.03)

"""The reference stays where joints and spring allow it: limits, blocked tools, singularities."""
import numpy as np
import pytest

from gdmp_ros.control.law import POSTURE_RATE
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.target import resting_target, STIFFNESS
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.quaternion import rotate_by_vector
from gdmp_ros.sim import Arm, ClosedLoop
from gdmp_ros.sim.teaching import Hand, HandSettings
from test.control.plants import CLEAN, on_every_plant

DT = 1e-3


def stiff(translation):
    return np.diag([translation] * 3 + [translation / 13.0] * 3)


def drive(loop, way, speed, seconds, stiffness):
    """Move a reference slowly away from where it is; what the joints keep from their limits."""
    start = loop.controller.reference[:7]
    size, nearest = float(np.linalg.norm(way)), np.inf
    for k in range(round(seconds / DT)):
        target = resting_target(start, stiffness)
        gone = speed * k * DT / size
        target[:3] += gone * np.asarray(way[:3])
        turned = np.empty(4)
        rotate_by_vector(start[3:].copy(), gone * np.asarray(way[3:]), turned)
        target[3:7] = turned
        target[7:13] = speed / size * np.asarray(way) * min(1.0, k / 100)
        loop.follow(target)
        tick = loop.tick()
        q = tick.measurement.position
        nearest = min(nearest, (q - loop.arm.limits.lower).min(),
                      (loop.arm.limits.upper - q).min())
    return nearest


@on_every_plant
@pytest.mark.parametrize('translation', [pytest.param(400.0, marks=pytest.mark.long), 2000.0])
@pytest.mark.parametrize('way', [
    (-1, 0, 0, 0, 0, 0), (1, 1, 0, 0, 0, 0), (0, 0, 0, 0, 1, 0),
    *(pytest.param(one, marks=pytest.mark.long)
      for one in ((0, 0, -1, 0, 0, 0), (0, 0, 0, 0, 0, 1), (0, 0, 0, 1, 0, 0)))])
def test_slow_references_drive_no_joint_into_its_limit(way, translation, plant):
    loop = plant.loop(limits=LimitSettings(workspace_min=(-1.0, -1.0, -0.5)))
    speed = 0.1 if any(way[:3]) else 0.3
    nearest = drive(loop, np.array(way, float), speed, 12.0, stiff(translation))
    assert nearest > 0.01


def blocked_and_released(speed, plant):
    """Speed of a tool of 1000 N/m that is held while its reference goes on, and then let go."""
    limits = LimitSettings() if speed is None else LimitSettings(tool_speed=speed)
    loop = plant.loop(limits=limits)
    start = loop.arm.measure().pose.copy()
    hand = Hand(start, HandSettings(stiffness=20_000.0, force=300.0))
    fastest = 0.0
    for k in range(6000):
        loop.driver.hand = hand if k < 3000 else None
        if k == 3000:
            loop.arm.push(np.zeros(6))
        target = resting_target(start, stiff(1000.0))
        target[1] += 0.1 * min(k * DT, 3.0)
        target[8] = 0.1 if 100 < k < 3000 else 0.0
        loop.follow(target)
        tick = loop.tick()
        if k >= 3000:
            fastest = max(fastest, float(np.linalg.norm(tick.twist[:3])))
        elif k > 2000:
            lead = loop.controller.reference[:3] - tick.measurement.pose[:3]
            assert np.linalg.norm(lead) < 0.065
    assert np.linalg.norm(tick.measurement.pose[:3] - target[:3]) < 0.002 + plant.slack(1000.0)
    return fastest


@on_every_plant
@pytest.mark.parametrize('speed, allowed', [(None, 0.6), (0.25, 0.3)])
def test_a_blocked_tool_that_is_released_is_slow(speed, allowed, plant):
    assert blocked_and_released(speed, plant) <= allowed


@on_every_plant
@pytest.mark.parametrize('side', [-0.25, 0.25])
def test_a_stretched_out_arm_moves_sideways(side, plant):
    loop = plant.loop()
    loop.reset(np.array([0.0, 0.3, 0.0, -0.75, 0.0, 1.2, np.pi / 4]))
    start = loop.arm.measure().pose.copy()
    angle = side / start[0]
    for k in range(6000):
        s = min(k / 4000, 1.0)
        target = resting_target(start, stiff(400.0))
        target[:2] = start[0] * np.array([np.cos(s * angle), np.sin(s * angle)])
        loop.follow(target)
        tick = loop.tick()
    assert np.linalg.norm(tick.measurement.pose[:3] - target[:3]) < 0.003 + plant.slack()


@on_every_plant
def test_a_joint_that_is_too_close_to_its_limit_only_goes_inwards(plant):
    loop = plant.loop()
    q, upper = loop.arm.data.qpos.copy(), loop.arm.limits.upper[5]
    q[5] = upper - 0.02
    loop.reset(q)
    start, governed = loop.arm.measure().pose.copy(), []
    for turn in (0.3, -0.3):
        for _ in range(1500):
            target = resting_target(start, stiff(400.0))
            rotate_by_vector(start[3:].copy(), np.array([0.0, turn, 0.0]), target[3:7])
            loop.controller.guard.arm()
            loop.follow(target)
            tick = loop.tick()
            governed.append(loop.controller.memory.governed[5])
            assert tick.measurement.position[5] < upper
    assert max(governed) <= q[5] + 1e-9 and min(governed) < upper - 0.1


@on_every_plant
def test_the_jerk_of_the_reference_is_limited(plant):
    loop = plant.loop(limits=LimitSettings(jerk=500.0))
    start, twists = loop.controller.reference, []
    for k in range(1500):
        target = resting_target(start[:7], start[STIFFNESS:55])
        target[1] += 0.018 if k % 500 < 250 else 0.0
        loop.follow(target)
        loop.tick()
        twists.append(loop.controller.reference[7:10])
    jerk = np.linalg.norm(np.diff(twists, 2, axis=0), axis=1) / DT ** 2
    assert 400.0 < jerk.max() <= 500.0 * (1 + 1e-6)


@on_every_plant
def test_a_posture_is_approached_without_moving_the_tool(plant):
    loop = plant.loop()
    home, start = loop.arm.measure().pose.copy(), loop.arm.data.qpos.copy()
    wanted = start + [0.3, 0, -0.3, 0, 0, 0, 0]
    loop.controller.posture.approach(wanted)
    rest = loop.controller.posture.position
    for _ in range(5000):
        tick, last = loop.tick(), rest
        assert np.linalg.norm(tick.measurement.pose[:3] - home[:3]) < 2e-3 + plant.slack()
        rest = loop.controller.posture.position
        assert np.abs(rest - last).max() <= POSTURE_RATE * DT * (1.0 + 1e-9)
    np.testing.assert_allclose(rest, wanted, atol=1e-4)
    elbow = tick.measurement.position - start
    least = 0.05 if plant is CLEAN else 0.02  # friction holds it back
    assert elbow[0] > least and elbow[2] < -least


@pytest.mark.parametrize('position, reason', [
    (np.zeros(6), 'expected 7 finite numbers'), (np.full(7, np.nan), 'expected 7 finite numbers'),
    (np.zeros(7), 'posture of joint 4 is 0 rad')])
def test_a_posture_that_the_arm_does_not_have_is_refused(position, reason):
    loop = ClosedLoop(Arm())
    with pytest.raises(ParameterError, match=reason):
        loop.controller.posture.approach(position)
    with pytest.raises(ParameterError, match=reason):
        loop.controller.configure(ControllerSettings(posture=tuple(position)))

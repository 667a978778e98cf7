"""An arm that is led by hand: weightless, inside its limits, held where it is left."""
from dataclasses import replace

import numpy as np
import pytest

from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.errors import RefusedError
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import PlantSettings
from gdmp_ros.sim.teaching import Hand, HandSettings
from test.control.plants import on_plants, PLANTS

#: How far friction holds the arm from the hand, which has 800 N/m [m].
SLACK = PLANTS['real'].slack(800.0)


#: A load of which nobody told the arm pulls it down: it carries itself only.
@pytest.fixture(params=['clean', pytest.param('real', marks=pytest.mark.long)])
def loop(request):
    made = PLANTS[request.param].loop()
    made.states.take(Request.GUIDE)
    return made


def ticks(loop, count):
    for _ in range(count):
        tick = loop.tick()
    return tick


def test_it_carries_itself_and_nothing_holds_it(loop):
    begin = loop.arm.measure().pose.copy()
    tick = ticks(loop, 1000)
    assert np.linalg.norm(tick.measurement.pose[:3] - begin[:3]) < 1e-3
    assert not tick.stiffness.any() and tick.spring == 0.0
    # A push that an arm which is held would spring back from moves it away for good.
    loop.arm.push(np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0]))
    ticks(loop, 300)
    loop.arm.push(np.zeros(6))
    tick = ticks(loop, 1500)
    assert tick.measurement.pose[1] - begin[1] > 0.02


def test_it_follows_a_hand_and_is_held_where_it_is_left(loop):
    place = loop.arm.measure().pose.copy()
    loop.driver.hand = Hand(place.copy())
    target = place.copy()
    for k in range(1500):
        target[:3] = place[:3] + min(k / 1000.0, 1.0) * np.array([0.05, 0.1, -0.05])
        loop.driver.hand.pose = target
        loop.tick()
    ticks(loop, 500)
    assert np.linalg.norm(loop.arm.measure().pose[:3] - target[:3]) < 0.003 + (
        SLACK if loop.controller.settings.friction.dry[0] else 0.0)
    loop.driver.hand = None
    loop.arm.push(np.zeros(6))
    loop.states.take(Request.RELEASE)
    left = loop.arm.measure().pose.copy()
    tick = ticks(loop, 1500)
    assert np.linalg.norm(tick.measurement.pose[:3] - left[:3]) < 0.005
    assert np.abs(tick.measurement.velocity).max() < 0.01
    assert tick.stiffness.reshape(6, 6)[0, 0] == pytest.approx(400.0)


@on_plants('clean', 'real')
@pytest.mark.parametrize('largest', [0.25, 1.0])
def test_a_strong_hand_does_not_move_it_faster_than_the_tool_may_be(plant, largest):
    loop = plant.loop(limits=LimitSettings(tool_speed=largest))
    loop.states.take(Request.GUIDE)
    fastest = 0.0
    for k in range(4000):
        turn = 2e-3 * np.pi * 0.5 * k  # half a turn in a second: it stays within reach
        loop.arm.push(np.array([40.0 * np.sin(turn), 40.0 * np.cos(turn), 0.0, 0.0, 0.0, 0.0]))
        fastest = max(fastest, np.linalg.norm(loop.tick().twist[:3]))
    assert 0.8 * min(largest, 0.6) < fastest <= 1.1 * largest


def test_the_wrench_that_is_felt_is_the_one_that_pushes():
    # At rest, dry friction holds against a push that the motors do not feel.
    loop = PLANTS['clean'].loop()
    loop.states.take(Request.GUIDE)
    push = np.array([3.0, -2.0, 1.0, 0.05, 0.1, -0.02])
    loop.arm.push(push)
    tick = ticks(loop, 20)
    np.testing.assert_allclose(tick.wrench, push, atol=0.15)


def test_a_hand_is_no_stronger_than_it_is(loop):
    far = loop.arm.measure().pose.copy()
    far[:3] += 1.0
    loop.driver.hand = Hand(far, HandSettings(force=20.0))
    loop.tick()
    force = loop.arm.data.xfrc_applied[loop.arm.tool_body, :3]
    assert np.linalg.norm(force) == pytest.approx(20.0)


def test_joint_limits_push_back_during_hand_guiding(loop):
    position = loop.arm.data.qpos.copy()
    position[3] = loop.arm.limits.upper[3] - 0.02
    loop.reset(position)
    loop.states.take(Request.GUIDE)
    tick = ticks(loop, 1)
    pushed = tick.torque - tick.measurement.bias
    assert pushed[3] == pytest.approx(-0.95, abs=1e-3)  # as fast as torques may change
    assert ticks(loop, 1500).measurement.position[3] < position[3] - 0.01


@pytest.mark.parametrize('plant', ['clean', pytest.param('real', marks=pytest.mark.long)])
@pytest.mark.parametrize('announced, there, asked', [(0.0, 1.0, True), (1.0, 0.0, True),
                                                     (0.0, 1.0, False)])
def test_with_a_wrong_payload_no_hand_guides_it(plant, announced, there, asked):
    """Asked for while the arm holds, or behind a motion."""
    settings = replace(PLANTS[plant].settings or PlantSettings(), payload=there)
    loop = PLANTS[plant]._replace(settings=settings).loop()
    loop.do(Request.PAYLOAD, Payload(announced))
    ticks(loop, 3000)
    wrong = f'{there - announced:+.1g}'[0]
    if asked:
        with pytest.raises(RefusedError, match=f'payload is wrong by \\{wrong}'):
            loop.do(Request.GUIDE)
    else:
        loop.move(PostureMotion(loop.joints, (loop.arm.home + 0.1)[None], 0.5))
        ticks(loop, 200)
        loop.do(Request.GUIDE)
        assert loop.states.state is State.STOPPING
        ticks(loop, 100)
        while loop.states.state is State.STOPPING:
            loop.tick()
    assert loop.states.state is not State.GUIDED
    left = loop.tick().measurement.pose.copy()
    tick = ticks(loop, 2000)
    assert np.linalg.norm(tick.measurement.pose[:3] - left[:3]) < 0.03


def test_a_small_error_of_the_payload_is_held_by_friction():
    loop = PLANTS['clean']._replace(settings=PlantSettings(payload=0.2)).loop()
    ticks(loop, 3000)
    loop.do(Request.GUIDE)
    assert loop.controller.memory.scalars.free_friction == pytest.approx(1.5 * 0.2 * 9.81, rel=0.2)
    left = loop.tick().measurement.pose.copy()
    tick = ticks(loop, 2500)
    assert np.linalg.norm(tick.measurement.pose[:3] - left[:3]) < 0.03
    loop.controller.memory.scalars.free_friction = 0.0
    tick = ticks(loop, 2500)
    assert np.linalg.norm(tick.measurement.pose[:3] - left[:3]) > 0.1

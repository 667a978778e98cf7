"""A skill is led around what is in its way, or says what blocks it."""
import numpy as np
import pytest

from experiments.obstacles import head_on, line, tool_trial, trap
from gdmp_ros import DataError, Demonstration, Euclidean, Skill, Sphere
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.learning.detour import BlockedError, detour, leads_around
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.scene.route import clearances, Tool
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.tool_shape import tool_of
from gdmp_ros.util.profiles import minimum_jerk
from test.dmp.test_frames import ELSEWHERE, shown
from test.motions import circles, motion

BALL = Tool.ball(0.04)
START, GOAL = np.array([0.4, -0.3, 0.3]), np.array([0.5, 0.3, 0.3])


def post(x=0.45, y=0.0, name='post', **others):
    return Volume(name, 'capsule', (0.04, 0.6), np.array([x, y, 0.3, 1.0, 0.0, 0.0, 0.0]),
                  **others)


def test_it_goes_around_and_keeps_the_rest(rng):
    skill = line(START, GOAL, np.zeros(3)).with_events(
        [GripperEvent(0.1, 0.0, 20.0, 0.1), GripperEvent(0.4, 0.08, 0.0, 0.1)])
    scene = Scene([post(), post(0.2, 0.4, 'far')], 0.02)
    found = detour(skill, scene, BALL)
    assert found.around == ('post',) and found.least > 0.0 and 1.0 < found.longer < 1.3
    assert found.skill.provenance['around'] == ['post']
    path = found.skill.rollout().sample(np.linspace(0.0, found.skill.duration, 2001))
    left, _ = clearances(scene.packed(), BALL, path.points[:, :3], path.points[0, 3:])
    assert left.min() > 0.0
    # Not faster than before, and with the same ends and events at the same places.
    plain = skill.rollout().sample(np.linspace(0.0, skill.duration, 2001))
    speed, before = [np.linalg.norm(np.gradient(one.points[:, :3], one.times, axis=0), axis=1)
                     for one in (path, plain)]
    assert speed.max() < 1.2 * before.max()
    np.testing.assert_allclose(path.points[-1], plain.points[-1], atol=1e-3)
    for event, other in zip(skill.events, found.skill.events):
        at, then = (one.points[round(2000 * each.progress), :3]
                    for one, each in ((plain, event), (path, other)))
        assert np.linalg.norm(at - then) < 0.005 and event.width == other.width


def test_a_path_that_is_free_stays_as_it_is():
    skill = line(START, GOAL, np.zeros(3))
    found = detour(skill, Scene([post(0.8, 0.3)], 0.02), BALL)
    assert found.skill is skill and found.around == () and found.longer == 1.0
    assert detour(skill, Scene(), BALL).skill is skill


def test_what_blocks_is_named():
    skill = line(START, GOAL, np.zeros(3))
    with pytest.raises(BlockedError, match='blocked by box: the tool is .* at the goal'):
        detour(skill, Scene([Volume('box', 'box', (0.1, 0.1, 0.1), np.array(
            [*GOAL, 1.0, 0.0, 0.0, 0.0]))]), BALL)
    wall = Volume('wall', 'box', (4.0, 0.05, 4.0), np.array([0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(BlockedError, match='blocked by wall: there is no way around'):
        detour(skill, Scene([wall]), BALL)


def test_a_skill_of_positions_alone_is_led_and_others_are_not(rng):
    blend = minimum_jerk(np.linspace(0.0, 1.0, 300))[:, None]
    plain = Skill.learn(Demonstration(np.linspace(0.0, 3.0, 300), START + blend * (GOAL - START),
                                      Euclidean(3)))
    assert detour(plain, Scene([post()]), BALL).around == ('post',)
    for skill in (Skill.learn(motion(Sphere(2), rng)),
                  Skill.learn_rhythmic(circles(Arm().pose_at(Arm().home), 0.05, 4.3, 0.03))):
        assert not leads_around(skill)
        with pytest.raises(DataError, match='only a skill with a position'):
            detour(skill, Scene([post()]), BALL)


@pytest.mark.parametrize('draw', [head_on, trap])
def test_the_arm_gets_past_a_wall_and_out_of_a_trap(draw, rng):
    """Random scenes: `python -m experiments obstacles random head-on trap`."""
    trial = tool_trial(*draw(rng, tool_of(Arm())))
    assert trial.exists and not trial.named and trial.contacts == 0
    assert trial.off < 0.005 and trial.least > 0.02 and trial.seconds < 2.0


def test_it_is_led_between_other_ends_and_with_its_frames_where_they_are():
    skill = line(START, GOAL, np.zeros(3))
    start, goal = skill.start + [0.0, 0.0, 0.05, 0, 0, 0, 0], skill.goal + [0.1, 0, 0, 0, 0, 0, 0]
    found = detour(skill, Scene([post(0.5)]), BALL, start=start, goal=goal).skill
    np.testing.assert_allclose(found.rollout().sample(
        np.array([0.0, found.duration])).points, [start, goal], atol=2e-3)
    framed = Skill.learn(shown()).with_frames(ELSEWHERE)
    way = framed.rollout().sample(np.linspace(0.0, framed.duration, 200)).points
    stands = post(*way[100, :2])
    led = detour(framed, Scene([stands]), BALL)
    assert led.around == ('post',) and not led.skill.views
    np.testing.assert_allclose(led.skill.rollout().sample(
        np.array([0.0, led.skill.duration])).points, way[[0, -1]], atol=3e-3)


def test_what_the_tool_carries_needs_room_and_what_it_may_touch_does_not_block():
    skill = line(START, GOAL, np.zeros(3))
    # It passes over the box; a stick that it carries does not.
    low = Volume('low', 'box', (0.3, 0.1, 0.1), np.array([0.45, 0.0, 0.15, 1.0, 0.0, 0.0, 0.0]))
    stick = Volume('stick', 'capsule', (0.01, 0.3), np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
                   carried=True)
    assert detour(skill, Scene([low]), BALL).around == ()
    assert detour(skill, Scene([low, stick]), BALL).around == ('low',)
    tool = tool_of(Arm())
    assert {'hand', 'left_finger'} <= tool.links and 'link4' not in tool.links
    goal = skill.goal[:3] - [0.0, 0.0, 0.04]
    cube = Volume('cube', 'box', (0.04, 0.04, 0.04), np.array([*goal, 1.0, 0.0, 0.0, 0.0]))
    with pytest.raises(BlockedError, match='blocked by cube: the tool is .* at the goal'):
        detour(skill, Scene([cube]), tool)
    may = Volume('cube', 'box', cube.size, cube.pose, allowed=tuple(tool.links))
    assert detour(skill, Scene([may]), tool).around == ()

"""A peg is put into holes at places that were not shown: contexts in a simulation with contact."""
import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator

from gdmp_ros import Demonstration, Skill
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.execution import execute
from gdmp_ros.sim.scenes import contact_count, HOLE_TOP, peg_and_hole, PEG_BELOW, PEG_HALF_LENGTH
from gdmp_ros.util.profiles import minimum_jerk

#: Distance of the hole from the base [m] and direction to it [rad].
LOW, HIGH = np.array([0.42, -0.6]), np.array([0.54, 0.6])
#: On each side of the peg; how deep it goes [m].
CLEARANCE, DEPTH = 0.003, 0.03
SAMPLES, DURATION = 200, 3.0
TOOL = tool_manifold(None)
pytestmark = pytest.mark.long


def place(distance, direction):
    return distance * np.cos(direction), distance * np.sin(direction)


def expert(distance, direction):
    """How a person does it: above the hole with the turn of the hole, and down."""
    home, s = Arm().pose_at(Arm().home), np.linspace(0.0, 1.0, SAMPLES)
    across, down = minimum_jerk(np.clip(s / 0.6, 0.0, 1.0)), minimum_jerk(
        np.clip((s - 0.6) / 0.4, 0.0, 1.0))
    over = HOLE_TOP + PEG_BELOW + PEG_HALF_LENGTH + 0.02
    points = np.tile(home, (SAMPLES, 1))
    points[:, :2] += across[:, None] * (np.array(place(distance, direction)) - home[:2])
    points[:, 2] += across * (over - home[2]) - down * (DEPTH + 0.02)
    rotation = UnitQuaternion()
    for row, share in enumerate(across):
        turn = 0.5 * share * direction
        about_z = np.array([np.cos(turn), 0.0, 0.0, np.sin(turn)])
        points[row, 3:] = rotation.align(_product(about_z, home[3:]), home[3:])
    return points


def _product(p, q):
    return np.concatenate([[p[0] * q[0] - p[1:] @ q[1:]],
                           p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])


def inserted(points, context):
    """The arm executes a path near a hole: measured positions by progress, depth, last contact."""
    arm = Arm(peg_and_hole(place(*context), context[1], CLEARANCE))
    path = Demonstration(np.linspace(0.0, DURATION, SAMPLES), points, TOOL)
    done = execute(Skill.learn(path, 60), arm)
    depth = HOLE_TOP - (done.measured[-1, 2] - PEG_BELOW - PEG_HALF_LENGTH)
    count = round(DURATION / arm.period)
    return done.measured[np.linspace(0, count - 1, SAMPLES).astype(int)], depth, contact_count(
        arm.model, arm.data, 'hole')


def grid(count):
    side = np.linspace(LOW, HIGH, count)
    return np.array([(d, a) for d in side[:, 0] for a in side[:, 1]])


def shown_to_the_arm(context):
    """The path that the arm measured while it was shown the way to a hole."""
    return inserted(expert(*context), context)[0]


@pytest.fixture(scope='module')
def skill():
    """Of 16 holes."""
    shown = [Demonstration(np.linspace(0.0, DURATION, SAMPLES), shown_to_the_arm(one), TOOL)
             for one in grid(4)]
    return Skill.learn(shown, 60, contexts=dict(zip(('distance', 'direction'), grid(4).T)))


def path_in(skill, context):
    return skill.in_context(context).rollout(duration=1.0).sample(
        np.linspace(0.0, 1.0, SAMPLES)).points


def test_pegs_go_into_holes_that_were_not_shown(skill, rng):
    for context in rng.uniform(LOW, HIGH, (3, 2)):
        path = path_in(skill, context)
        away = np.linalg.norm((path - shown_to_the_arm(context))[:, :3], axis=1)
        assert away.max() < 2e-3
        assert inserted(path, context)[1] > DEPTH - 0.002


def test_sixteen_holes_teach_as_much_as_a_dense_sampling(skill, rng):
    dense = grid(8)
    between = LinearNDInterpolator(dense, [shown_to_the_arm(one).reshape(-1) for one in dense])
    errors = []
    for context in rng.uniform(LOW, HIGH, (8, 2)):
        wanted, _, _ = inserted(shown_to_the_arm(context), context)
        points = between(*context).reshape(SAMPLES, 7)
        points[:, 3:] /= np.linalg.norm(points[:, 3:], axis=1, keepdims=True)
        errors.append([np.linalg.norm((inserted(path, context)[0] - wanted)[:, :3], axis=1).mean()
                       for path in (path_in(skill, context), points)])
    ours, usual = np.mean(errors, axis=0)
    print(f'ours {1e3 * ours:.2f} mm, dense sampling {1e3 * usual:.2f} mm')
    assert ours <= 1.5 * usual


def test_the_skill_without_the_context_misses_the_hole(skill):
    context = (0.5, 0.5)
    path = skill.rollout(duration=1.0).sample(np.linspace(0.0, 1.0, SAMPLES)).points
    _, depth, contacts = inserted(path, context)
    assert depth < DEPTH - 0.002 or contacts == 0
    assert np.linalg.norm(path[-1, :2] - place(*context)) > 0.1

"""What is predicted of a motion, and how takes vary around it."""
import numpy as np
import pytest

from gdmp_ros import DataError, Rollout, Skill
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.playback.prediction import likely_path, Tube
from test.motions import takes, TOOL


@pytest.fixture(scope='module')
def skill():
    return Skill.learn(takes(TOOL, 9, np.random.default_rng(3)), 40)


def test_a_tube_has_the_spread_of_drawn_motions_between_known_ends(skill):
    tube, s3 = Tube(skill, 40), UnitQuaternion()
    known = skill.distribution.condition([(0.0, skill.start), (1.0, skill.goal)])
    rng, progress = np.random.default_rng(0), np.array([0.25, 0.5, 0.75])
    mean = Rollout(known, duration=1.0).sample(progress).points
    away = []
    for _ in range(200):
        made = known.distribution.sample(rng).rollout(duration=1.0).sample(progress).points
        away.append([np.concatenate([a[:3] - b[:3], 2.0 * s3.log(b[3:7], a[3:7])])
                     for a, b in zip(made, mean)])
    # The unexplained rest is not drawn; rotations count in radians, not as half-angles.
    noise = np.repeat([1.0, 4.0], 3) * known.variation.noise[:6]
    stated = np.diagonal(tube.covariances(progress), axis1=1, axis2=2) - noise
    found = np.mean(np.square(away), axis=0)
    np.testing.assert_allclose(np.sqrt(found / stated), 1.0, atol=0.25)


def test_start_and_goal_are_known(skill):
    ends = Tube(skill, 40).covariances(np.array([0.0, 0.5, 1.0, 1.3]))
    sizes = np.sqrt(np.trace(ends[:, :3, :3], axis1=1, axis2=2))
    assert max(sizes[0], sizes[2], sizes[3]) < 0.1 * sizes[1]


def test_a_likely_path_leads_between_the_given_poses(skill):
    first, last = skill.start[:7].copy(), skill.goal[:7].copy()
    first[:3] += 0.05
    last[:3] -= 0.1
    poses, covariances = likely_path(skill, first, last, 50)
    assert poses.shape == (51, 7) and covariances.shape == (51, 6, 6)
    np.testing.assert_allclose(poses[0], first, atol=1e-9)
    np.testing.assert_allclose(poses[-1, :3], last[:3], atol=3e-3)


def test_a_single_take_has_no_tube():
    shown = takes(TOOL, 1, np.random.default_rng(3))
    with pytest.raises(DataError, match='single take'):
        Tube(Skill.learn(shown), 40)

"""Relations between factors: two arms, equal points, distances; on all manifolds."""
from dataclasses import replace
import json

import numpy as np
import pytest

from gdmp_ros import (
    Coupling,
    DataError,
    Demonstration,
    Euclidean,
    GdmpWarning,
    ParameterError,
    Product,
    Skill,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.dmp.primitive import Gains, MIN_STEPS
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.manifolds.quaternion import rotate_by_vector

ARM = Product(Euclidean(3), UnitQuaternion(), names=['position', 'orientation'])
LEFT, RIGHT = (tuple(f'{side}_{name}' for name in ARM.names) for side in ('left', 'right'))
GRASP = np.array([0.05, -0.5, 0.02, 0.9, 0.1, 0.2, 0.37])
GRASP[3:] /= np.linalg.norm(GRASP[3:])
#: So fast a phase that the start term ends at once: the Lyapunov function is that of Theorem 1.
ALPHA_X = 1e6
CASES = {
    'pose': Product(Euclidean(3), UnitQuaternion(), Euclidean(3), UnitQuaternion()),
    'relative R3': Product(Euclidean(3), Euclidean(3)),
    'relative S3': Product(UnitQuaternion(), UnitQuaternion()),
    'relative SO3': Product(SpecialOrthogonal(3), SpecialOrthogonal(3)),
    'distance R3': Product(Euclidean(3), Euclidean(3)),
    'distance S2': Product(Sphere(2), Sphere(2)),
    'distance S3': Product(UnitQuaternion(), UnitQuaternion()),
    'distance SPD3': Product(SymmetricPositiveDefinite(3), SymmetricPositiveDefinite(3))}
RUNS = 8  # of each case: 64


def arm_path(noise=0.0, seed=0):
    rng, s = np.random.default_rng(seed), np.linspace(0.0, 1.0, 401)
    u = s ** 3 * (10 - 15 * s + 6 * s * s)
    points = np.zeros((401, 7))
    points[:, 0], points[:, 1], points[:, 2] = 0.4 + 0.2 * u, 0.1 * np.sin(6 * u), 0.4 + 0.1 * u
    for row, a in zip(points, u):
        rotate_by_vector(np.array([1.0, 0, 0, 0]), 0.4 * np.array([np.sin(3 * a), a, -a]), row[3:])
        row[:3] += noise * rng.standard_normal(3)
    return 4.0 * s, points


def taught(points, duration=4.0):
    return Skill.learn(Demonstration(np.linspace(0.0, duration, len(points)), points, ARM))


@pytest.fixture(scope='module')
def pair():
    """Two arms, learned apart with noise of 1 mm, and coupled."""
    _, left = arm_path(1e-3, 1)
    right = np.array([compose(row, GRASP) for row in arm_path(1e-3, 2)[1]])
    joined = Skill.joined(taught(left), taught(right, 3.0), ('left', 'right'))
    point = np.concatenate([arm_path()[1][-1], compose(arm_path()[1][-1], GRASP)])
    return joined.coupled(Coupling.at('pose', LEFT, RIGHT, joined.manifold, point))


def moved(skill, both):
    """Another goal of the left arm, which the right one follows or not."""
    goal = skill.goal.copy()
    goal[:3] += [0.05, -0.1, 0.04]
    rotate_by_vector(goal[3:7].copy(), np.array([0.3, 0.2, -0.25]), goal[3:7])
    return skill.related(goal) if both else goal


def worst(skill, coupling, goal, seconds=8.5):
    rollout, result, accelerations = skill.rollout(), np.zeros(2), []
    for k in range(round(1000 * seconds)):
        if k == 1800:
            rollout.retarget(goal)
        state = rollout.advance(1e-3)
        accelerations.append(state.acceleration.copy())
        result = np.maximum(result, coupling.deviation(skill.manifold, state.point))
    return result, np.array(accelerations), rollout


@pytest.mark.parametrize('both', [True, False], ids=['the other goal follows', 'it does not'])
def test_a_goal_switch_of_one_arm_keeps_the_relation(pair, both):
    away, accelerations, rollout = worst(pair, pair.couplings[0], moved(pair, both))
    assert away[0] <= 1e-4 and away[1] <= 5e-4
    # No ripple, no step; velocities of the start, learned apart, become equal in 10 ms.
    assert np.abs(np.diff(accelerations[10:, :3], axis=0)).max() < 0.05
    # With goals that contradict each other neither is reached, and the motion says so.
    assert rollout.finished and ('not_settled' in rollout.flags) is not both


def test_without_the_coupling_it_does_not(pair):
    away, _, _ = worst(replace(pair, couplings=()), pair.couplings[0], moved(pair, False))
    assert away[0] > 0.05 and away[1] > 0.1


def test_the_leader_does_not_feel_the_follower(pair):
    led = replace(pair, couplings=(replace(pair.couplings[0], leads=True),))
    goal = moved(pair, False)
    alone = replace(pair, couplings=()).rollout()
    rollout = led.rollout()
    for k in range(5000):
        if k == 1800:
            rollout.retarget(goal)
            alone.retarget(goal)
        state, free = rollout.advance(1e-3), alone.advance(1e-3)
        assert np.array_equal(state.point[:7], free.point[:7])
        away = led.couplings[0].deviation(led.manifold, state.point)
        assert away[0] <= 2e-4 and away[1] <= 5e-4


def test_a_deviation_at_the_start_fades_out_without_a_step(pair):
    start = pair.start.copy()
    start[7:10] += [0.02, 0.01, -0.01]
    rollout = pair.rollout(start=start)
    first = rollout.advance(0.0)
    usual = np.abs(pair.rollout().sample(np.linspace(0, 0.02, 21)).velocities).max()
    path = rollout.sample(np.linspace(0.0, 4.0, 4001))
    coupling = pair.couplings[0]
    assert np.abs(first.point - start).max() < 1e-12
    assert np.abs(path.velocities[:20]).max() < usual + 0.01
    assert coupling.deviation(pair.manifold, path.points[-1])[0] < 1e-5


def relative_case(name, seed):
    """A skill of springs alone, from near the relation, with goals that contradict it."""
    rng, manifold, kind = np.random.default_rng(seed), CASES[name], name.split()[0]
    half = len(manifold.names) // 2
    alpha_z = float(np.exp(rng.uniform(np.log(5.0), np.log(100.0))))
    base = manifold.random_point(rng)
    if kind == 'distance':
        factor = manifold.factors[0]
        one = factor.random_point(rng)
        way = factor.random_tangent(one, rng)
        base = manifold.join(one, factor.exp(one, way * rng.uniform(0.2, 1.0)
                                             / factor.norm(one, way)))
    coupling = Coupling.at(kind, manifold.names[:half], manifold.names[half:], manifold, base,
                           rate=float(np.exp(rng.uniform(np.log(20.0), np.log(2000.0)))))

    def near():
        way = manifold.random_tangent(base, rng)
        return manifold.exp(base, way * rng.uniform(0.1, 0.8) / manifold.norm(base, way))
    start, goal = coupling.related(manifold, near()), near()
    frame = manifold.frame(start)
    velocity = 0.2 * rng.uniform(0.0, 0.5) * alpha_z * manifold.random_tangent(start, rng)
    return Skill(manifold, 'parallel', Gains(alpha_z, ALPHA_X), start, goal, frame, 1.0,
                 manifold.to_frame(frame, velocity), np.zeros((2, manifold.tangent_size)),
                 MIN_STEPS, couplings=(coupling,))


def energies(skill, seconds, samples=800):
    """V + U along a roll-out, over ``alpha_z beta_z``."""
    manifold, coupling, rollout = skill.manifold, skill.couplings[0], skill.rollout()
    path = rollout.sample(np.linspace(0.0, seconds, samples))
    scale = skill.gains.alpha_z * skill.gains.beta_z
    stiffness = np.array([one.stiffness for one in rollout.motion.relations])
    halves = np.array([0.5 if isinstance(manifold.factors[one.second], UnitQuaternion)
                       and coupling.kind != 'distance' else 1.0
                       for one in coupling.terms(manifold)])
    return np.array([
        manifold.distance(point, skill.goal) ** 2 + manifold.norm(point, velocity) ** 2 / scale
        + stiffness @ (halves * coupling.deviation(manifold, point)) ** 2 / scale
        for point, velocity in zip(path.points, path.velocities)])


@pytest.mark.parametrize('name', CASES)
def test_energy_and_potential_never_grow(name):
    for seed in range(RUNS):
        skill = relative_case(name, seed)
        total = energies(skill, 40.0 / skill.gains.alpha_z)
        assert (total - np.minimum.accumulate(total)).max() < 1e-12 * total[0]
        assert total[-1] < 0.99 * total[0]


def test_a_wrong_force_would_be_seen():
    """The same check with a potential that is not that of the force."""
    rises = []
    for seed in range(5):
        skill = relative_case('pose', seed)
        one = skill.couplings[0]
        other = replace(one, relation=(*(np.array(one.relation[:3]) + 0.1), *one.relation[3:]))
        right = energies(skill, 1.0)
        path = skill.rollout().sample(np.linspace(0.0, 1.0, 800))
        total = right + [100.0 * other.deviation(skill.manifold, p)[0] ** 2 for p in path.points]
        rises.append((total - np.minimum.accumulate(total)).max() / total[0])
    assert max(rises) > 1e-3


@pytest.mark.parametrize('given', [0, 1])
@pytest.mark.parametrize('name', CASES)
def test_one_side_follows_the_other(name, given):
    skill = relative_case(name, 3)
    coupling, manifold = skill.couplings[0], skill.manifold
    point = coupling.related(manifold, skill.goal, given)
    assert coupling.deviation(manifold, skill.goal).max() > 1e-3
    assert coupling.deviation(manifold, point).max() < 1e-9
    half = len(manifold.names) // 2
    kept = slice(0, half) if given == 0 else slice(half, None)
    for cut in manifold.point_slices[kept]:
        assert np.array_equal(point.reshape(-1)[cut], skill.goal.reshape(-1)[cut])


def test_a_file_keeps_the_coupling(pair, tmp_path):
    pair.save(tmp_path / 'pair.json')
    read = Skill.load(tmp_path / 'pair.json')
    times = np.linspace(0.0, 5.0, 100)
    assert read.couplings == pair.couplings
    assert np.array_equal(read.rollout().sample(times).points, pair.rollout().sample(times).points)


@pytest.mark.parametrize(('change', 'message'), [
    ({'kind': 'glue'}, 'kind'), ({'first': ['left_hand']}, 'no factor'),
    ({'relation': [1.0]}, 'numbers'), ({'rate': 1e5}, 'at most'), ({'leads': 1}, 'objects'),
    ({'relation': [float(i) for i in range(7)]}, 'norm')])
def test_a_wrong_coupling_in_a_file_is_refused(pair, tmp_path, change, message):
    pair.save(tmp_path / 'pair.json')
    document = json.loads((tmp_path / 'pair.json').read_text())
    document['couplings'][0].update(change)
    (tmp_path / 'wrong.json').write_text(json.dumps(document))
    with pytest.raises(DataError, match=message):
        Skill.load(tmp_path / 'wrong.json')


def test_what_cannot_be_coupled_says_why(pair):
    manifold, one = pair.manifold, pair.couplings[0]
    with pytest.raises(ParameterError, match='same kind'):
        Coupling.at('relative', 'left_position', 'right_orientation', manifold, pair.goal)
    with pytest.raises(ParameterError, match='parallel'):
        replace(pair, connection='published')
    with pytest.raises(ParameterError, match='couplings'):
        pair.rollout(frame=np.eye(12))
    with pytest.raises(ParameterError, match='couplings'):
        Skill.joined(pair, pair)
    with pytest.raises(ParameterError, match='gains'):
        Skill.joined(*(taught(arm_path()[1]), Skill.learn(Demonstration(
            *arm_path(), ARM), alpha_z=40.0)))
    far = replace(one, relation=(0.5, *one.relation[1:]))
    with pytest.warns(GdmpWarning, match='demonstrations'):
        replace(pair, couplings=()).coupled(far)


def test_the_path_does_not_depend_on_the_time_step(pair):
    first, second = pair.rollout(), pair.rollout()
    ends = [first.advance(4.0).point]
    for _ in range(1000):
        ends.append(second.advance(0.004).point)
    assert np.abs(ends[0] - ends[-1]).max() < 1e-12


@pytest.mark.parametrize('size', [0.3, 1.0, 2.5])
@pytest.mark.parametrize('dt', [0.0005, 0.02])
def test_a_start_whose_orientation_is_far_from_the_relation_does_not_jump(pair, size, dt, rng):
    """Both sides follow one relation, which becomes the wanted one."""
    for _ in range(3):
        start, axis = pair.related(pair.start), rng.standard_normal(3)
        rotate_by_vector(start[10:].copy(), size * axis / np.linalg.norm(axis), start[10:])
        start[7:10] += 0.2 * rng.standard_normal(3)
        times = np.arange(0.0, 5.0, dt)
        points = pair.rollout(start=start).sample(times).points
        plain = pair.rollout(start=pair.related(pair.start)).sample(times).points
        step, usual = (np.linalg.norm(np.diff(path[:, 7:10], axis=0), axis=1).max()
                       for path in (points, plain))
        # The offset fades with smoothstep, at most 1.875 times its mean speed, in a quarter.
        away = np.linalg.norm(start[7:10] - plain[0, 7:10])
        assert step < 1.2 * usual + 2.0 * away * dt / (0.25 * pair.duration)
        later = points[times > 0.27 * pair.duration][::max(1, round(0.02 / dt))]
        assert max(pair.couplings[0].deviation(pair.manifold, one).max() for one in later) < 1e-3


@pytest.mark.parametrize('name', CASES)
def test_a_relation_fades_from_far(name, rng):
    for seed in range(4):
        skill = relative_case(name, seed)
        manifold, coupling = skill.manifold, replace(skill.couplings[0], rate=1000.0)
        skill = replace(skill, gains=Gains(), velocity=0.0 * skill.velocity, duration=3.0,
                        goal=coupling.related(manifold, skill.goal), steps=3000,
                        couplings=(coupling,))
        away = manifold.random_tangent(skill.goal, rng)
        start = manifold.exp(skill.goal, 1.5 / manifold.norm(skill.goal, away) * away)
        times = np.arange(0.0, 4.0, 2e-3)
        points = skill.rollout(start=start).sample(times).points
        flat = points.reshape(len(times), -1)
        steps = np.linalg.norm(manifold.factor_distances(flat[:-1].copy(), flat[1:].copy()),
                               axis=1)
        # The relation fades in 0.75 s, the motion ends in about one.
        assert steps.max() < 3.0 * 2e-3 / 0.75 * 1.5
        assert max(coupling.deviation(manifold, one).max() for one in points[times > 0.9]) < 5e-3

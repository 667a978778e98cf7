"""Learning and rolling out, on every manifold and with both connections."""
import json
import math

import numpy as np
import pytest

from gdmp_ros import (
    CutLocusError,
    DataError,
    Demonstration,
    Euclidean,
    GdmpError,
    ManifoldError,
    ParameterError,
    Product,
    Rollout,
    Skill,
    SpecialOrthogonal,
    Sphere,
    SymmetricPositiveDefinite,
    UnitQuaternion,
)
from gdmp_ros.data import lasa
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.util.profiles import minimum_jerk

CONNECTIONS = ['parallel', 'published']
TOOL = Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(3),
               names=['position', 'orientation', 'stiffness'])
MANIFOLDS = [Euclidean(2), Sphere(2), UnitQuaternion(), SpecialOrthogonal(3),
             SpecialOrthogonal(4), SymmetricPositiveDefinite(2), TOOL]


def curve(manifold, base, rng, samples=400, duration=2.0, size=0.6):
    """A smooth curve that starts at rest, moves in several directions and ends at rest."""
    t = np.linspace(0.0, 1.0, samples)
    blend = minimum_jerk(t)
    first, second = manifold.random_tangent(base, rng), manifold.random_tangent(base, rng)
    first *= size / manifold.norm(base, first)
    second *= size / manifold.norm(base, second)
    wave = 0.4 * np.sin(2.0 * np.pi * blend)
    points = [manifold.exp(base, a * first + b * second) for a, b in zip(blend, wave)]
    return Demonstration(duration * t, np.array(points), manifold)


@pytest.fixture(params=MANIFOLDS, ids=repr)
def demonstration(request, rng):
    manifold = request.param
    return curve(manifold, manifold.random_point(rng), rng)


def distances(manifold, a, b):
    return np.array([manifold.distance(x, y) for x, y in zip(a, b)])


@pytest.mark.parametrize('connection', CONNECTIONS)
@pytest.mark.parametrize('mapping', [*lasa.MAPPINGS, lasa.COVARIANCES])
@pytest.mark.parametrize('name', ['GShape', pytest.param('Sine', marks=pytest.mark.long)])
def test_handwriting_is_reproduced_for_any_dt(name, mapping, connection):
    shown = lasa.data_set(name, mapping)[0]
    skill = Skill.learn(shown, n_basis=60, connection=connection, end='moving')
    # Of all 30 classes the covariances are 3e-4 on average; these two are harder.
    largest = 2e-3 if mapping == lasa.COVARIANCES else 8e-5
    for dt in (1e-3, 2e-3, 5e-3, 10e-3):
        assert reproduction_error(skill, shown, dt)[0] <= largest


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_the_demonstration_is_reproduced(demonstration, connection):
    skill = Skill.learn(demonstration, connection=connection)
    assert reproduction_error(skill, demonstration, 5e-3)[0] < 2e-3


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_the_path_does_not_depend_on_the_time_steps(demonstration, connection, rng):
    skill = Skill.learn(demonstration, connection=connection)
    whole = Rollout(skill)
    fine = [whole.advance(1e-3).point for _ in range(1500)]
    cut = Rollout(skill)
    for _ in range(200):
        state = cut.advance(rng.integers(1, 14) * 1e-3)
        index = round(state.time / 1e-3)
        if index > len(fine):
            break
        assert skill.manifold.distance(state.point, fine[index - 1]) < 1e-9


def explicit_transport(skill, nodes):
    """The same leapfrog with every vector carried explicitly along the curve's own steps."""
    manifold, gains = skill.manifold, skill.gains
    h, y = 1.0 / skill.steps, skill.start
    velocity = np.zeros(manifold.tangent_size)
    decay = math.exp(-gains.alpha_z * h)

    def carried(source, target, *vectors):
        return [manifold.transport(source, target, v) for v in vectors]

    centres = np.exp(-gains.alpha_x * np.arange(skill.n_basis) / (skill.n_basis - 1))
    widths = 1.0 / np.diff(centres) ** 2
    widths = np.append(widths, widths[-1])
    # Weights as tangents at the start, carried along with the point.
    frame = basis_of(manifold, skill.start)
    weights = list(skill.weights @ frame)
    velocity = skill.velocity @ frame
    start_to_goal = manifold.log(skill.start, skill.goal)
    path = [y]
    for k in range(nodes):
        middle = manifold.exp(y, 0.5 * h * velocity)
        velocity, start_to_goal, *weights = carried(y, middle, velocity, start_to_goal, *weights)
        x = math.exp(-gains.alpha_x * (k + 0.5) * h)
        exponent = widths * (x - centres) ** 2
        psi = np.exp(exponent.min() - exponent)
        forcing = x * (psi / psi.sum()) @ np.array(weights)
        pull = manifold.log(middle, skill.goal) - x * start_to_goal + forcing
        velocity = decay * velocity + (1.0 - decay) * gains.beta_z * pull
        y = manifold.exp(middle, 0.5 * h * velocity)
        velocity, start_to_goal, *weights = carried(middle, y, velocity, start_to_goal, *weights)
        path.append(y)
    return np.array(path)


def basis_of(manifold, point):
    """Rows: the tangents at ``point`` that the coordinates of a fresh frame stand for."""
    if manifold.kind == 'spd':
        lower = np.linalg.cholesky(point)
        m = len(point)
        rows = []
        for k in range(manifold.tangent_size):
            unit = np.zeros((m, m))
            i, j = [(a, b) for a in range(m) for b in range(a, m)][k]
            unit[i, j] = unit[j, i] = 1.0 if i == j else 1.0 / math.sqrt(2.0)
            tangent = lower @ unit @ lower.T
            rows.append([tangent[a, b] * (1.0 if a == b else math.sqrt(2.0))
                         for a in range(m) for b in range(a, m)])
        return np.array(rows)
    return np.eye(manifold.tangent_size)


@pytest.mark.parametrize('manifold', [Sphere(2), UnitQuaternion(), SpecialOrthogonal(3),
                                      SymmetricPositiveDefinite(2),
                                      SymmetricPositiveDefinite(3)], ids=repr)
def test_parallel_equals_explicit_transport_along_the_curve(manifold, rng):
    shown = curve(manifold, manifold.random_point(rng), rng)
    skill = Skill.learn(shown, n_basis=8)
    nodes = 1500
    expected = explicit_transport(skill, nodes)
    times = skill.duration * np.arange(nodes + 1) / skill.steps
    got = Rollout(skill).sample(times).points
    assert distances(manifold, expected, got).max() < 1e-9


def isometries(manifold, rng):
    """Isometries of a manifold, the inversions among them."""
    other = manifold.random_point(rng)
    if manifold.kind == 'spd':
        a = rng.standard_normal((manifold.size, manifold.size)) + 2.0 * np.eye(manifold.size)
        return [lambda y: a @ y @ a.T, np.linalg.inv]
    if manifold.kind == 'rotation':
        return [lambda y: other @ y, lambda y: y @ other, lambda y: y.T]
    if manifold.kind == 'quaternion':
        w, x, y, z = other
        left = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
        right = np.array([[w, -x, -y, -z], [x, w, z, -y], [y, -z, w, x], [z, y, -x, w]])
        conjugate = np.diag([1.0, -1.0, -1.0, -1.0])
        return [lambda q: left @ q, lambda q: right @ q, lambda q: conjugate @ q]
    turn, _ = np.linalg.qr(rng.standard_normal((len(other), len(other))))
    return [lambda v: turn @ v]


@pytest.mark.parametrize('manifold', [Sphere(2), UnitQuaternion(), SpecialOrthogonal(3),
                                      SymmetricPositiveDefinite(3)], ids=repr)
def test_parallel_is_equivariant_under_isometries_and_inversions(manifold, rng):
    shown = curve(manifold, manifold.random_point(rng), rng)
    goal = manifold.exp(shown.points[-1], 0.2 * manifold.random_tangent(shown.points[-1], rng))

    def run(move):
        rollout = Rollout(Skill.learn(
            Demonstration(shown.times, np.array([move(p) for p in shown.points]), manifold)))
        before = rollout.sample(np.arange(0.0, 1.0, 0.01)).points
        rollout.retarget(move(goal))
        return np.concatenate([before, rollout.sample(np.arange(1.0, 3.0, 0.01)).points])

    plain = run(lambda y: y)
    for move in isometries(manifold, rng):
        moved = np.array([move(p) for p in plain])
        assert distances(manifold, run(move), moved).max() < 1e-9


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_saved_and_loaded_skills_roll_out_bit_identically(demonstration, connection, tmp_path):
    skill = Skill.learn(demonstration, connection=connection)
    skill.save(tmp_path / 'skill.json')
    loaded = Skill.load(tmp_path / 'skill.json')
    np.testing.assert_array_equal(skill.reproduce(3e-3).points, loaded.reproduce(3e-3).points)
    np.testing.assert_array_equal(skill.reproduce(3e-3).velocities,
                                  loaded.reproduce(3e-3).velocities)


@pytest.mark.parametrize('change, reason', [
    (lambda d: d.update(version=99), 'format version is 99'),
    (lambda d: d.update(format='other'), 'not a skill file'),
    (lambda d: d['weights'].pop() and d.update(weights=d['weights'][:1]), 'at least 2'),
    (lambda d: d['weights'][0].__setitem__(0, 'x'), 'weights: expected numbers'),
    (lambda d: d.update(duration=-1.0), 'duration is -1'),
    (lambda d: d.update(manifold={'kind': 'klein bottle'}), 'unknown kind'),
    (lambda d: d.update(start=[1.0]), 'start: shape'),
    (lambda d: d['start'].__setitem__(3, 7.0), 'quaternion norm'),
    (lambda d: d['frame'].__setitem__(0, 5.0), 'not the frame at the start'),
    (lambda d: d.update(connection='bent'), 'expected one of parallel, published'),
    (lambda d: d['gains'].update(alpha_z=0.0), 'alpha_z is 0.0'),
    (lambda d: d.update(steps='many'), 'steps: expected an integer'),
])
def test_damaged_skill_files_are_refused_with_the_reason(change, reason, rng, tmp_path):
    path = tmp_path / 'skill.json'
    Skill.learn(curve(TOOL, TOOL.random_point(rng), rng)).save(path)
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(DataError, match=reason) as caught:
        Skill.load(path)
    assert str(path) in str(caught.value)


def test_truncated_and_missing_skill_files_are_refused(rng, tmp_path):
    path = tmp_path / 'skill.json'
    Skill.learn(curve(Euclidean(2), np.zeros(2), rng)).save(path)
    path.write_text(path.read_text()[:200])
    with pytest.raises(DataError, match='not a skill file'):
        Skill.load(path)
    with pytest.raises(DataError, match='No such file'):
        Skill.load(tmp_path / 'nothing.json')
    with pytest.raises(DataError, match='cannot write'):
        Skill.learn(curve(Euclidean(2), np.zeros(2), rng)).save(tmp_path / 'no' / 'folder.json')


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_a_switched_goal_is_reached(demonstration, connection, rng):
    manifold = demonstration.manifold
    skill = Skill.learn(demonstration, connection=connection)
    goal = manifold.exp(skill.goal, 0.3 * manifold.random_tangent(skill.goal, rng))
    rollout = Rollout(skill)
    rollout.advance(1.1)
    rollout.retarget(goal)
    while not rollout.finished:
        state = rollout.advance(0.01)
    assert rollout.flags == set()
    assert manifold.distance(state.point, goal) < 0.005
    state = rollout.advance(20.0)
    assert manifold.distance(state.point, goal) < 1e-6


def test_the_moving_goal_follows_the_closed_form(rng):
    manifold = UnitQuaternion()
    skill = Skill.learn(curve(manifold, manifold.random_point(rng), rng))
    goal = manifold.exp(skill.goal, np.array([0.1, 0.2, -0.1]))
    one, two = Rollout(skill), Rollout(skill)
    for rollout, steps in ((one, 1), (two, 200)):
        rollout.advance(0.5)
        rollout.retarget(goal)
        for _ in range(steps):
            rollout.advance(1.0 / steps)
    # The same goal and the same path with other time steps.
    assert manifold.distance(one.state.point, two.state.point) < 1e-9
    elapsed = 8.0 * (0.75 - 0.25 - 1.0 / skill.steps)
    assert manifold.distance(one.motion.points.goal, goal) == pytest.approx(
        manifold.distance(skill.goal, goal) * math.exp(-elapsed), rel=1e-2)


def test_many_goals_in_a_row_and_both_signs_of_a_quaternion(rng):
    skill = Skill.learn(curve(TOOL, TOOL.random_point(rng), rng))
    one, other = Rollout(skill), Rollout(skill)
    for _ in range(20):
        position, orientation, stiffness = TOOL.split(skill.goal)
        goal = [position + 0.1 * rng.standard_normal(3),
                UnitQuaternion().exp(orientation, 0.2 * rng.standard_normal(3)), stiffness]
        one.retarget(TOOL.join(*goal))
        other.retarget(TOOL.join(goal[0], -goal[1], goal[2]))
        a, b = one.advance(0.03), other.advance(0.03)
        np.testing.assert_array_equal(a.point, b.point)


def test_a_goal_that_is_no_point_is_refused_and_nothing_changes(rng):
    manifold = Sphere(2)
    skill = Skill.learn(curve(manifold, manifold.random_point(rng), rng))
    rollout, plain = Rollout(skill), Rollout(skill)
    with pytest.raises(ManifoldError, match='norm is 2'):
        rollout.retarget(2.0 * skill.goal)
    np.testing.assert_array_equal(rollout.advance(1.0).point, plain.advance(1.0).point)


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_tempo_changes_and_stops_never_leave_the_path(demonstration, connection):
    skill = Skill.learn(demonstration, connection=connection)
    path, rollout = Rollout(skill), Rollout(skill)
    for scale in [1.0, 2.0, 0.3, 0.0, 0.0, 1.5, 0.7] * 2:
        rollout.set_speed(scale)
        for _ in range(50):
            state = rollout.advance(2e-3)
        same = path.advance((rollout.progress - path.progress) * skill.duration)
        assert skill.manifold.distance(state.point, same.point) < 1e-9


def test_tempo_changes_at_a_bounded_rate_and_stops_smoothly(rng):
    skill = Skill.learn(curve(Euclidean(3), np.zeros(3), rng))
    rollout = Rollout(skill)
    rollout.advance(1.0)
    rollout.set_speed(0.0)
    speeds = []
    for _ in range(600):
        state = rollout.advance(1e-3)
        speeds.append(rollout.speed)
    rates = np.diff(speeds) / 1e-3
    assert np.abs(rates).max() <= 5.0 + 1e-9
    assert np.abs(np.diff(rates)).max() <= 5.0 * 1e-3 / 0.02  # the rate has no step either
    assert min(speeds) >= 0.0
    assert rollout.speed == 0.0
    assert np.linalg.norm(state.velocity) == 0.0
    still = rollout.advance(5.0)
    np.testing.assert_array_equal(still.point, state.point)
    with pytest.raises(ParameterError, match='speed is 3'):
        rollout.set_speed(3)


def test_velocity_is_the_derivative_of_the_path_and_continuous(rng):
    skill = Skill.learn(curve(UnitQuaternion(), np.array([1.0, 0, 0, 0]), rng))
    rollout, manifold = Rollout(skill), skill.manifold
    states = [rollout.advance(1e-4) for _ in range(4000)]
    for a, b, c in zip(states[500:-2:100], states[501:-1:100], states[502::100]):
        numeric = (manifold.log(b.point, c.point) - manifold.log(b.point, a.point)) / 2e-4
        np.testing.assert_allclose(b.velocity, numeric, atol=1e-5)
    velocities = np.array([s.velocity for s in states])
    bound = 1.5e-4 * np.linalg.norm([s.acceleration for s in states], axis=1).max()
    assert np.abs(np.diff(velocities, axis=0)).max() < bound


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_the_motion_ends_and_stays_at_the_goal(demonstration, connection):
    skill = Skill.learn(demonstration, connection=connection)
    rollout = Rollout(skill)
    assert not rollout.finished
    rollout.advance(skill.duration * 1.5)
    state = rollout.state
    assert rollout.finished
    assert skill.manifold.distance(state.point, skill.goal) < 1e-4
    assert np.linalg.norm(state.velocity) < 1e-3


@pytest.mark.parametrize('connection', CONNECTIONS)
def test_points_stay_on_the_manifold_for_many_steps(demonstration, connection, rng):
    stays_on_the_manifold(demonstration, connection, rng, 100_000)


@pytest.mark.long
def test_points_stay_on_the_manifold_for_a_million_steps(rng):
    shown = curve(TOOL, TOOL.random_point(rng), rng)
    stays_on_the_manifold(shown, 'parallel', rng, 1_000_000)


def stays_on_the_manifold(demonstration, connection, rng, steps):
    skill = Skill.learn(demonstration, n_basis=300, connection=connection)
    manifold = skill.manifold
    rollout = Rollout(skill)
    near = manifold.exp(skill.goal, 0.05 * manifold.random_tangent(skill.goal, rng))
    goals = [near, skill.goal]
    times = skill.duration * np.linspace(0.0, steps / skill.steps, 11)
    for i, time in enumerate(times[1:]):
        rollout.retarget(goals[i % 2])
        point = rollout.sample(np.array([time])).points[0]
        assert np.isfinite(point).all()
        assert np.abs(manifold.project(point) - point).max() < 1e-9
    assert rollout.flags == set()


def test_start_elsewhere_begins_there_and_reaches_the_goal(demonstration, rng):
    manifold = demonstration.manifold
    skill = Skill.learn(demonstration)
    start = manifold.exp(skill.start, 0.2 * manifold.random_tangent(skill.start, rng))
    velocity = 0.1 * manifold.random_tangent(start, rng)
    rollout = Rollout(skill, start=start, velocity=velocity)
    assert manifold.distance(rollout.state.point, start) < 1e-12
    np.testing.assert_allclose(rollout.state.velocity, velocity, atol=1e-9)
    rollout.advance(skill.duration * 1.6)
    assert manifold.distance(rollout.state.point, skill.goal) < 1e-3
    at_rest = Rollout(skill, start=start, speed=0.0)
    assert np.linalg.norm(at_rest.state.velocity) == 0.0


def test_duration_scales_time_and_not_the_path(demonstration):
    skill = Skill.learn(demonstration)
    slow, fast = Rollout(skill, duration=4.0), Rollout(skill, duration=1.0)
    for _ in range(20):
        a, b = slow.advance(0.2), fast.advance(0.05)
        assert skill.manifold.distance(a.point, b.point) < 1e-9
        np.testing.assert_allclose(4.0 * a.velocity, b.velocity, atol=1e-7)


def test_several_demonstrations_average_start_goal_and_duration(rng):
    manifold = UnitQuaternion()
    base = manifold.random_point(rng)
    shown = []
    for duration in (1.8, 2.0, 2.2):
        away = manifold.exp(base, 0.05 * rng.standard_normal(3))
        one = curve(manifold, away, np.random.default_rng(3), duration=duration)
        shown.append(Demonstration(one.times, -one.points if duration == 2.0 else one.points,
                                   manifold))
    skill = Skill.learn(shown)
    assert skill.duration == pytest.approx(2.0)
    starts = [manifold.align(d.points[0], shown[0].points[0]) for d in shown]
    assert manifold.distance(skill.start, manifold.mean(starts)) < 1e-6
    assert reproduction_error(skill, shown).max() < 0.1


def test_irregular_stamps_are_resampled_and_give_the_same_skill(rng):
    manifold = UnitQuaternion()
    shown = curve(manifold, manifold.random_point(rng), rng, samples=400)
    warped = shown.times + 1e-3 * np.sin(40.0 * shown.times)
    warped[0], warped[-1] = shown.times[0], shown.times[-1]
    irregular = Demonstration(warped, shown.at(warped), manifold)
    assert not irregular.is_uniform
    a, b = Skill.learn(shown).reproduce(0.01), Skill.learn(irregular).reproduce(0.01)
    assert distances(manifold, a.points, b.points).max() < 1e-4


@pytest.mark.parametrize('goal, leaves', [(50.0, False), (1.0, True)])
def test_a_far_goal_drives_published_out_of_the_cone_and_it_is_held(goal, leaves):
    manifold = SymmetricPositiveDefinite(3)
    start, goal = 1000.0 * np.eye(3), goal * np.eye(3)
    times = np.linspace(0.0, 1.0, 200)
    blend = minimum_jerk(times)
    shown = Demonstration(times, np.array([manifold.geodesic(start, 0.9 * start, b)
                                           for b in blend]), manifold)
    parallel = Rollout(Skill.learn(shown))
    parallel.retarget(goal)
    parallel.advance(4.0)
    assert manifold.distance(parallel.state.point, goal) < 0.01 and parallel.flags == set()
    published = Rollout(Skill.learn(shown, connection='published'))
    published.retarget(goal)
    for _ in range(400):
        manifold.check_point(published.advance(0.01).point)
    assert ('held' in published.flags) == leaves
    if leaves:
        before = published.state.point.copy()
        np.testing.assert_array_equal(published.advance(1.0).point, before)
        assert np.linalg.norm(published.state.velocity) == 0.0
    else:
        assert manifold.distance(published.state.point, goal) < 0.01


def test_not_settled_is_flagged_until_a_new_goal(rng):
    skill = Skill.learn(curve(Euclidean(2), np.zeros(2), rng))
    rollout = Rollout(skill, tolerances=[1e-12])
    rollout.advance(0.9 * skill.duration)
    rollout.retarget(skill.goal + 1.0)
    rollout.advance(1.2 * skill.duration)
    assert rollout.finished and rollout.flags == {'not_settled'}
    rollout.retarget(skill.goal)
    assert not rollout.finished and rollout.flags == set()


def test_the_state_is_valid_before_the_first_advance(demonstration):
    skill = Skill.learn(demonstration)
    state = Rollout(skill).state
    np.testing.assert_allclose(state.point, skill.start, atol=1e-12)
    assert state.time == 0.0 and state.phase == 1.0
    assert state.velocity.shape == (skill.manifold.tangent_size,)


def test_reproduce_samples_from_zero_to_the_duration(demonstration):
    trajectory = Skill.learn(demonstration).reproduce(0.3)
    np.testing.assert_allclose(trajectory.times, [0, 0.3, 0.6, 0.9, 1.2, 1.5, 1.8, 2.0])
    assert trajectory.points.shape[0] == trajectory.velocities.shape[0] == 8


def test_bad_input_is_refused_with_its_place(rng):
    manifold, t = UnitQuaternion(), np.linspace(0.0, 1.0, 5)
    good = np.tile([1.0, 0, 0, 0], (5, 1))
    with pytest.raises(DataError, match='at least 3'):
        Demonstration(t[:2], good[:2], manifold)
    broken = good.copy()
    broken[3] *= 0.93
    with pytest.raises(DataError, match=r'norm is 0.93, expected 1 .*sample 3'):
        Demonstration(t, broken, manifold)
    with pytest.raises(DataError, match='stamps must increase: sample 2'):
        Demonstration([0.0, 0.5, 0.4, 0.8, 1.0], good, manifold)
    with pytest.raises(DataError, match='shape'):
        Demonstration(t, good[:, :3], manifold)
    with pytest.raises(DataError, match='got none'):
        Skill.learn([])
    with pytest.raises(ParameterError, match='n_basis is 1'):
        Skill.learn(curve(Euclidean(1), np.zeros(1), rng), n_basis=1)
    with pytest.raises(ParameterError, match='connection'):
        Skill.learn(curve(Euclidean(1), np.zeros(1), rng), connection='flat')
    with pytest.raises(GdmpError, match='dt is 0'):
        Skill.learn(curve(Euclidean(1), np.zeros(1), rng)).reproduce(0)
    with pytest.raises(DataError, match='the first on'):
        Skill.learn([curve(Euclidean(1), np.zeros(1), rng), curve(Euclidean(2), np.zeros(2), rng)])


def test_without_segments_a_demonstration_through_its_goals_antipode_is_refused():
    t = np.linspace(0.0, 1.0, 601)
    angle = 1.5 * np.pi * t
    points = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * t])
    goal_opposite = Demonstration(t, points, Sphere(2))
    assert np.abs(points + points[-1]).max(axis=1).min() < 1e-12  # passes through -G exactly
    with pytest.raises(CutLocusError, match='sample'):
        Skill.learn(goal_opposite, split=False)


def test_quaternion_demonstrations_are_made_sign_continuous(rng):
    manifold = UnitQuaternion()
    shown = curve(manifold, manifold.random_point(rng), rng)
    flips = rng.choice([-1.0, 1.0], len(shown.times))
    flipped = Demonstration(shown.times, shown.points * flips[:, None], manifold)
    assert (np.sum(flipped.points[1:] * flipped.points[:-1], axis=1) > 0.0).all()


def test_lyapunov_function_decreases_in_parallel(rng):
    """[GDMP] Theorem 1: V = ½ alpha_z beta_z d² + ½ |Z|² with F = 0 and the start term gone."""
    for manifold in (Sphere(2), UnitQuaternion(), SymmetricPositiveDefinite(2)):
        start = manifold.random_point(rng)
        v = manifold.random_tangent(start, rng)
        goal = manifold.exp(start, 0.8 * v / manifold.norm(start, v))
        t = np.linspace(0.0, 1.0, 50)
        line = np.array([manifold.geodesic(start, goal, x) for x in t])
        shown = Demonstration(t, line, manifold)
        skill = Skill.learn(shown, alpha_g=2000.0)
        rollout = Rollout(skill)
        rollout.advance(1.2)  # past the end only the spring is left
        rollout.retarget(manifold.exp(goal, 0.5 * manifold.random_tangent(goal, rng)))
        rollout.advance(0.021)  # the goal has arrived, the point has not
        goal, gains, values = rollout.goal, skill.gains, []
        for _ in range(200):
            state = rollout.advance(0.002)
            speed = manifold.norm(state.point, state.velocity)
            values.append(0.5 * gains.alpha_z * gains.beta_z
                          * manifold.distance(state.point, goal) ** 2 + 0.5 * speed ** 2)
        assert values[0] > 1.0
        assert (np.diff(values) <= 1e-6 * values[0]).all()
        assert values[-1] < 1e-3 * values[0]

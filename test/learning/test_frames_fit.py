"""Learning in task frames: which frame matters where is found from how takes agree."""
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gdmp_ros import (
    DataError,
    Demonstration,
    Euclidean,
    fit_report,
    GdmpWarning,
    ParameterError,
    Rollout,
    Skill,
)
from gdmp_ros.manifolds.poses import compose, inverse, tool_manifold
from gdmp_ros.util.profiles import minimum_jerk

DURATION, SAMPLES = 5.0, 200
SPACE = Euclidean(3)


def frame(rng, situation):
    turn = Rotation.from_euler('z', situation * rng.uniform(-1.5, 1.5)).as_matrix()
    return turn, situation * rng.uniform(-0.15, 0.15, 3)


def shown(rng, via=True, warp=0.0, noise=0.0, situation=1.0):
    """
    A way out of a start frame, over a via object in its middle, into a goal frame.

    Each object decides the way near it: its points are a smooth blend of what each asks for.
    """
    frames = {name: frame(rng, situation) for name in ('start', 'via', 'goal')}
    frames['goal'] = frames['goal'][0], frames['goal'][1] + [0.5, 0.0, 0.0]
    frames['via'] = frames['via'][0], frames['via'][1] + [0.25, 0.0, 0.15]
    return Demonstration(np.linspace(0.0, DURATION, SAMPLES), wanted(
        frames, via, warp) + rng.normal(0.0, noise, (SAMPLES, 3)), SPACE, frames=frames)


def wanted(frames, via=True, warp=0.0):
    s = np.linspace(0.0, 1.0, SAMPLES)
    s = s + warp * s * (1.0 - s)
    early = np.stack([0.05 * np.sin(3.0 * s), np.zeros_like(s), 0.3 * s], axis=1)
    late = np.stack([0.1 * (1.0 - s), 0.0 * s, 0.3 * (1.0 - s)], axis=1)
    over = np.stack([0.4 * (s - 0.5), 0.0 * s, 0.02 + 0.0 * s], axis=1)
    ways = [points @ turn.T + origin for points, (turn, origin) in zip(
        (early, over, late), (frames['start'], frames['via'], frames['goal']))]
    last = minimum_jerk(s)[:, None]
    middle = np.exp(-((s - 0.5) / 0.14) ** 4)[:, None] if via else 0.0
    return (1.0 - middle) * ((1.0 - last) * ways[0] + last * ways[2]) + middle * ways[1]


def errors(skill, rng, count=20, via=True, situation=1.0):
    """Mean distance from what would be shown in other situations [m]."""
    found = []
    for _ in range(count):
        demo = shown(rng, via, situation=situation)
        used = {view.name: demo.frames[view.name] for view in skill.views}
        path = Rollout(skill, demo.points[0], frames=used).sample(demo.times).points
        found.append(np.linalg.norm(path - demo.points, axis=1).mean())
    return float(np.mean(found))


def without(demo, *names):
    return Demonstration(demo.times, demo.points, SPACE, frames={
        name: one for name, one in demo.frames.items() if name not in names})


def share(skill, name, s=0.5):
    view = next(view for view in skill.views if view.name == name)
    return float(np.interp(s, np.linspace(0.0, 1.0, len(view.shares)), view.shares[:, 0]))


@pytest.mark.parametrize('seed', range(3))
def test_an_object_that_matters_in_the_middle_is_found_from_five_takes(seed):
    rng = np.random.default_rng(seed)
    takes = [shown(rng, noise=5e-4) for _ in range(5)]
    three = Skill.learn(takes)
    two = Skill.learn([without(take, 'via') for take in takes])
    assert [view.name for view in three.views] == ['start', 'via', 'goal']
    assert share(three, 'via') > 0.5
    assert share(three, 'via', 0.02) == share(three, 'via', 0.98) == 0.0
    assert errors(three, np.random.default_rng(99)) < 0.6 * errors(
        two, np.random.default_rng(99))


@pytest.mark.parametrize('seed', range(5))
def test_an_object_that_does_not_matter_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    skill = Skill.learn([shown(rng, via=False, noise=5e-4) for _ in range(5)])
    demo, paths = shown(rng, via=False), []
    for shift in (-0.3, 0.3):
        frames = {**demo.frames, 'via': demo.frames['via'] + shift * np.eye(7)[0]}
        paths.append(Rollout(skill, frames=frames).sample(demo.times).points)
    assert np.abs(paths[0] - paths[1]).max() < 1e-3


def test_of_one_take_start_and_goal_alone_matter(rng):
    skill = Skill.learn(shown(rng))
    assert max(view.shares[:, 0].max() for view in skill.views if view.name == 'via') == 0.0
    shares = np.array([view.shares[:, 0] for view in skill.views])
    assert np.allclose(shares.sum(axis=0), 1.0) and shares[0, 0] == shares[-1, -1] == 1.0


def test_a_detail_is_kept_if_the_timing_of_the_takes_differs():
    takes, s = [], np.linspace(0.0, 1.0, SAMPLES)
    for k, warp in enumerate((-0.7, -0.3, 0.2, 0.6, 0.0)):
        take = shown(np.random.default_rng(k), False, warp, situation=0.2)
        dip = np.exp(-((s + warp * s * (1.0 - s) - 0.6) / 0.05) ** 2)[:, None] * [0.0, 0.0, -0.15]
        takes.append(Demonstration(take.times, take.points + dip, SPACE, frames=take.frames))
    depths = []
    for align in (True, False):
        demo = shown(np.random.default_rng(9), False, situation=0.2)
        path = Rollout(Skill.learn(takes, align=align), frames={
            name: demo.frames[name] for name in ('start', 'goal')}).sample(demo.times).points
        depths.append((demo.points - path)[:, 2].max())
    assert depths[0] > 0.12 and depths[1] < 0.1


def test_takes_of_one_timing_are_left_as_they_are():
    same = [shown(np.random.default_rng(k), via=False, noise=5e-4) for k in range(4)]
    assert np.array_equal(*(Skill.learn(same, align=given).views[0].skill.weights
                            for given in (True, False)))


def test_the_report_compares_with_the_frames_of_each_take(rng):
    takes = [shown(rng, via=False) for _ in range(4)]
    report = fit_report(Skill.learn(takes), takes)
    assert max(one.relative_error for one in report.demonstrations) < 0.15
    single = fit_report(Skill.learn(takes[0]), takes[0])
    assert single.demonstrations[0].relative_error < 1e-3


def test_a_frame_that_moves_while_it_is_shown_counts_where_it_is(rng):
    """Shown beside a goal that moves: executed at a goal that stands, and at one that moves."""
    standing = shown(rng, via=False)
    velocity = np.array([0.03, -0.02, 0.01])
    late = minimum_jerk(standing.times / DURATION)[:, None]
    path = standing.points + late * standing.times[:, None] * velocity
    moved = Demonstration(standing.times, path, SPACE, frames={
        'start': standing.frames['start'],
        'goal': standing.frames['goal'] + standing.times[:, None] * np.append(
            velocity, np.zeros(4))})
    skill = Skill.learn(moved)
    still = {name: standing.frames[name] for name in ('start', 'goal')}
    path = Rollout(skill, frames=still).sample(standing.times).points
    assert np.linalg.norm(path - standing.points, axis=1).max() < 0.01
    assert np.linalg.norm(path[-1] - standing.points[-1]) < 1e-3
    assert fit_report(skill, moved).demonstrations[0].relative_error < 0.03


def test_names_of_start_and_goal(rng):
    demo = shown(rng)
    renamed = Demonstration(demo.times, demo.points, SPACE, frames={
        'box': demo.frames['start'], 'hole': demo.frames['goal']})
    with pytest.warns(GdmpWarning, match="'box' is taken for that of the start, 'hole'"):
        skill = Skill.learn(renamed)
    assert [view.name for view in skill.views] == ['box', 'hole']
    back = Skill.learn(renamed, start_frame='hole', goal_frame='box')
    assert [view.name for view in back.views] == ['hole', 'box']
    only = Skill.learn(without(renamed, 'box'))
    assert [view.name for view in only.views] == ['base', 'hole']
    with pytest.raises(ParameterError, match='box, hole'):
        Skill.learn(renamed, goal_frame='cup')
    with pytest.raises(ParameterError, match='no frames'):
        Skill.learn(without(renamed, 'box', 'hole'), goal_frame='cup')
    with pytest.raises(DataError, match='no frame in common'):
        Skill.learn([without(renamed, 'box'), without(renamed, 'hole')])
    with pytest.warns(GdmpWarning, match='via: not in all'):
        Skill.learn([demo, without(demo, 'via')])


@pytest.mark.parametrize('frames, reason', [
    ({'goal': np.zeros((7, 7))}, 'shape'), ({'goal': 'here'}, 'goal'), ([1.0], 'names with poses'),
    ({'goal': (np.eye(3), [np.nan, 0.0, 0.0])}, 'finite')])
def test_a_demonstration_with_frames_that_are_none_is_refused(frames, reason, rng):
    with pytest.raises(DataError, match=reason):
        Demonstration(np.linspace(0.0, 1.0, 20), np.zeros((20, 3)), SPACE, frames=frames)


def test_what_frames_are_not_learned_with_is_refused(rng):
    takes = [shown(rng) for _ in range(3)]
    for options in ({'contexts': {'height': [1.0, 2.0, 3.0]}},
                    {'demonstration_weights': [1.0, 2.0, 3.0]}):
        with pytest.raises(ParameterError, match='not together with task frames'):
            Skill.learn(takes, **options)


PLACE = tool_manifold(None)


def pose(x, y, z, yaw=0.0):
    return np.array([x, y, z, np.cos(yaw / 2.0), 0.0, 0.0, np.sin(yaw / 2.0)])


def carried(rng, box, shelf, belt=0.0, noise=0.0, grasps=True):
    """
    A box that is taken to a shelf, and tracked by a camera while it is carried.

    :param belt: speed of the belt on which it comes [m/s]
    :param noise: standard deviation of the camera [m]
    :param grasps: False: the tool waits above the box, and goes to the shelf without it
    """
    times = np.linspace(0.0, 6.0, 300)
    at = np.array([compose(box, pose(0.0, belt * min(t, 2.5), 0.0)) for t in times])
    down, up = minimum_jerk(np.clip(times / 2.0, 0, 1)), minimum_jerk(
        np.clip((times - 2.5) / 3.5, 0, 1))
    above = pose(0.0, 0.0, 0.02)
    begins, ends = pose(0.2, -0.3, 0.4), compose(shelf, pose(0.0, 0.0, 0.05))
    held = np.array([compose(frame, above) for frame in at])
    tool = np.array([PLACE.geodesic(PLACE.geodesic(begins, hold, float(a)), ends, float(b))
                     for hold, a, b in zip(held, down, up)])
    tool[:, 2] += 0.1 * np.sin(np.pi * up) ** 2
    if grasps:
        carries = times >= 2.5
        at[carries] = [compose(point, inverse(above)) for point in tool[carries]]
    at[:, :3] += noise * rng.normal(size=(300, 3))
    return Demonstration(times, tool, PLACE, frames={'box': at, 'shelf': shelf})


@pytest.mark.parametrize(('belt', 'noise'), [(0.0, 0.0), (0.0, 5e-4), (0.05, 0.0), (0.05, 5e-4)])
def test_a_box_that_was_grasped_rests_where_it_was_grasped(belt, noise, rng):
    demo = carried(rng, pose(0.4, -0.2, 0.1, 0.5), pose(0.6, 0.2, 0.3), belt, noise)
    with pytest.warns(GdmpWarning, match='frame box: the tool holds the object from .* %'):
        skill = Skill.learn(demo)
    # Where it was grasped, it does what was shown, also while the box is carried.
    path = Rollout(skill, frames={'box': skill.views[0].pose}).sample(demo.times).points
    carries = demo.times > 2.6
    assert np.linalg.norm((path - demo.points)[carries, :3], axis=1).max() < 5e-3
    grasped = skill.views[0].grasped
    assert 1.5 / 6.0 < grasped < 2.7 / 6.0  # held from 2 s on, carried from 2.5 s on
    assert skill.views[-1].grasped is None
    # Executed elsewhere, with a camera that goes on looking: the box follows the tool.
    box, shelf = pose(0.5, -0.1, 0.1, -0.3), pose(0.5, 0.3, 0.2, 0.4)
    wanted = carried(np.random.default_rng(0), box, shelf, belt)
    results = []
    for looks in (True, False):
        rollout = Rollout(skill, frames={'box': box, 'shelf': shelf})
        grip = compose(inverse(wanted.frames['box'][130]), wanted.points[130])
        rows = []
        for step in range(3500):
            now = step * 2e-3
            point = rollout.advance(2e-3).point
            rows.append(point)
            if step % 16 == 0 and now < 2.5:
                rollout.move_frame('box', compose(box, pose(0.0, belt * now, 0.0)))
            elif step % 16 == 0 and looks:
                rollout.move_frame('box', compose(point, inverse(grip)))
            elif step % 16 == 0 and rollout.progress >= grasped:
                rollout.rest_frame('box')
        assert rollout.finished
        results.append(np.array(rows))
    # What the camera sees of the box in the gripper changes nothing.
    assert np.abs(results[0] - results[1]).max() < (1e-3 if belt else 1e-9)
    error = np.linalg.norm(results[0][-1, :3] - wanted.points[-1, :3])
    assert error < 2e-3


def test_a_tool_that_follows_a_belt_has_not_grasped_it(rng, recwarn):
    demo = carried(rng, pose(0.4, -0.2, 0.1, 0.5), pose(0.6, 0.2, 0.3), 0.05, grasps=False)
    at = np.array([compose(pose(0.4, -0.2, 0.1, 0.5), pose(0.0, 0.05 * t, 0.0))
                   for t in demo.times])
    skill = Skill.learn(Demonstration(demo.times, demo.points, PLACE, frames={
        'box': at, 'shelf': demo.frames['shelf']}))
    assert skill.views[0].grasped is None
    assert not [one for one in recwarn if 'holds the object' in str(one.message)]


def test_an_object_that_some_takes_grasp_only_is_refused(rng):
    takes = [carried(rng, pose(0.4, -0.2, 0.1), pose(0.6, 0.2, 0.3), grasps=grasps)
             for grasps in (True, False)]
    with pytest.raises(DataError, match='frame box: the tool carries the object in some'):
        Skill.learn(takes)

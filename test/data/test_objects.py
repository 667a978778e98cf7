"""Task frames from the transforms of bags."""
from dataclasses import replace

import numpy as np
import pytest
from rosbags.typesys import get_typestore, Stores

from gdmp_ros import DataError, Demonstration, GdmpWarning, ParameterError, Rollout, Skill
from gdmp_ros.data import bags, recordings
from gdmp_ros.data.columns import Import
from gdmp_ros.data.objects import with_objects
from gdmp_ros.data.skills import LearningSettings, skill_from_bags
from gdmp_ros.manifolds.poses import compose, inverse, tool_manifold
from gdmp_ros.util.profiles import minimum_jerk
from test.commands import gdmp
from test.dmp.test_frames import apart, ELSEWHERE, ENTERS, pose, SHOWN, shown
from test.pictures import drawn

BEGINS = 1_700_000_000_000_000_000
CLOCK = np.arange(-0.5, 6.0, 1.0 / 30.0)


STORE = get_typestore(Stores.ROS2_JAZZY)


def message(kind, **parts):
    return STORE.types[kind](**parts)


def transform(writer, topic, name, stamp, at):
    """Write a transform of a frame in ``base``."""
    x, y, z, qw, qx, qy, qz = map(float, at)
    item = message(
        'geometry_msgs/msg/TransformStamped',
        header=message('std_msgs/msg/Header', frame_id='base', stamp=message(
            'builtin_interfaces/msg/Time', sec=stamp // bags.NS, nanosec=stamp % bags.NS)),
        child_frame_id=name, transform=message(
            'geometry_msgs/msg/Transform',
            translation=message('geometry_msgs/msg/Vector3', x=x, y=y, z=z),
            rotation=message('geometry_msgs/msg/Quaternion', x=qx, y=qy, z=qz, w=qw)))
    kind = 'tf2_msgs/msg/TFMessage'
    writer.raw(topic, kind, stamp, bytes(STORE.serialize_cdr(
        message(kind, transforms=[item]), kind)))


def record(bag, demo, static=None, seen=None):
    """A bag with the poses of a demonstration, and frames from /tf_static and /tf."""
    with bags.BagWriter(bag) as writer:
        for name, at in (static or {}).items():
            transform(writer, '/tf_static', name, BEGINS - bags.NS, at)
        for name, where in (seen or {}).items():
            for time in CLOCK:
                at = where(time)
                if at is not None:
                    transform(writer, '/tf', name, BEGINS + round(time * bags.NS), at)
        for time, point in zip(demo.times, demo.points):
            writer.pose('/pose', BEGINS + round(time * bags.NS), point[:7], 'base')
    return bag


def with_noise(at):
    rng = np.random.default_rng(0)
    return lambda time: at + np.append(rng.normal(0.0, 3e-4, 3), np.zeros(4))


def test_a_skill_is_learned_from_the_transforms_of_its_bags(tmp_path):
    demo = shown(count=200)
    bag = record(tmp_path / 'take', demo, {'box': SHOWN['start']},
                 {'hole': with_noise(SHOWN['goal'])})
    skill = skill_from_bags([bag], LearningSettings(
        60, objects=('box', 'hole'), ends=('box', 'hole'))).skill
    assert [view.name for view in skill.views] == ['box', 'hole']
    rollout = Rollout(skill, frames={'box': ELSEWHERE['start'], 'hole': ELSEWHERE['goal']})
    end = rollout.sample(np.linspace(0.0, 8.0, 20)).points[-1]
    assert max(apart(end, compose(ELSEWHERE['goal'], ENTERS))) < 1e-3


def test_a_frame_that_moves_is_told_and_one_that_is_declared_moving_is_followed(tmp_path):
    demo, velocity = shown(count=200), np.array([0.03, 0.0, 0.0])
    late = minimum_jerk(demo.times / 5.0)[:, None]
    points = demo.points.copy()
    points[:, :3] += late * demo.times[:, None] * velocity
    moved = Demonstration(demo.times, points, demo.manifold)

    def where(time):
        return SHOWN['goal'] + np.append(time * velocity, np.zeros(4))
    bag = record(tmp_path / 'take', moved, {'start': SHOWN['start']}, {'goal': where})
    recording = recordings.read(bag)
    known, _ = recordings.with_stiffness([recording], 'none')
    with pytest.warns(GdmpWarning, match='goal moved by .* not declared moving'):
        with_objects([recording], known, ['start', 'goal'])
    followed = with_objects([recording], known, ['start', 'goal'], ['goal'])[0]
    assert followed.frames['goal'].shape == (len(followed.times), 7)
    offset = (recording.begins - BEGINS) / bags.NS
    assert np.abs(followed.frames['goal'][-1] - where(followed.times[-1] + offset)).max() < 1e-6
    skill = Skill.learn(followed)
    still = Rollout(skill, frames=SHOWN).sample(np.linspace(0.0, 8.0, 20)).points[-1]
    assert max(apart(still, compose(SHOWN['goal'], ENTERS))) < 3e-3


@pytest.mark.parametrize('turned', [False, True], ids=['in the base', 'in the camera'])
def test_poses_on_a_topic_are_frames_too(turned, tmp_path):
    demo, camera = shown(count=200), pose([0.1, -0.5, 0.4], [0.3, 0.0, 1.0])
    bag = tmp_path / 'take'
    with bags.BagWriter(bag) as writer:
        transform(writer, '/tf_static', 'camera', BEGINS - bags.NS, camera)
        transform(writer, '/tf_static', 'start', BEGINS - bags.NS, SHOWN['start'])
        seen = compose(inverse(camera), SHOWN['goal']) if turned else SHOWN['goal']
        for time in CLOCK:
            writer.pose('/hole_pose', BEGINS + round(time * bags.NS), seen,
                        'camera' if turned else 'base')
        for time, point in zip(demo.times, demo.points):
            writer.pose('/pose', BEGINS + round(time * bags.NS), point, 'base')
    skill = skill_from_bags([bag], LearningSettings(
        60, pose_topic='/pose', objects=('start', 'goal=/hole_pose'), moving=('goal',))).skill
    assert np.abs(skill.views[-1].pose - SHOWN['goal']).max() < 1e-9
    with pytest.raises(DataError, match='no topic /cup; the bag has'):
        skill_from_bags([bag], LearningSettings(60, pose_topic='/pose',
                                                objects=('start', 'goal=/cup')))


def table_of(path, **takes):
    parts = ('x', 'y', 'z', 'qw', 'qx', 'qy', 'qz')
    names = list(next(iter(takes.values())))
    lines = [','.join(['take', *(f'{name}.{part}' for name in names for part in parts)])]
    lines += [','.join([take, *(f'{number:.12g}' for name in names for number in frames[name])])
              for take, frames in takes.items()]
    path.write_text('\n'.join(lines) + '\n')
    return path


def test_a_table_tells_where_objects_were_in_files_of_other_programs(tmp_path):
    for name, frames in (('a', SHOWN), ('b', ELSEWHERE)):
        demo = shown(frames, count=200)
        rows = [','.join(map('{:.12g}'.format, (time, *point)))
                for time, point in zip(demo.times, demo.points)]
        (tmp_path / f'{name}.csv').write_text('\n'.join(['t,x,y,z,qw,qx,qy,qz', *rows]) + '\n')
    table = table_of(tmp_path / 'objects.txt', **{'a.csv': SHOWN, 'b.csv': ELSEWHERE})
    done = gdmp('learn', tmp_path / 'a.csv', tmp_path / 'b.csv', '-o', tmp_path / 'skill.json',
                '--n-basis', 60, '--object-table', table)
    assert done.returncode == 0, done.stderr
    skill = Skill.load(tmp_path / 'skill.json')
    assert [view.name for view in skill.views] == ['start', 'goal']
    end = Rollout(skill, frames=ELSEWHERE).goal
    assert max(apart(end, compose(ELSEWHERE['goal'], ENTERS))) < 2e-3
    for lines, reason in ((['take,hole.x', 'a.csv,1', 'b.csv,2'], 'no column hole.y'),
                          (['take,x,y', 'a.csv,1,2', 'b.csv,2,3'], 'no column .x')):
        table.write_text('\n'.join(lines))
        done = gdmp('learn', tmp_path / 'a.csv', tmp_path / 'b.csv', '-o', tmp_path / 'no.json',
                    '--object-table', table)
        assert done.returncode == 1 and reason in done.stderr
        assert not (tmp_path / 'no.json').exists()
    bag = record(tmp_path / 'take', shown(count=200), SHOWN)
    with pytest.raises(DataError, match="frame 'goal' is named twice"):
        skill_from_bags([bag], LearningSettings(60, objects=('goal',), object_table=table_of(
            table, take=SHOWN)))


@pytest.mark.parametrize('kind', ['csv', 'npz'])
def test_columns_and_arrays_of_other_programs_are_frames_too(kind, tmp_path):
    """A hole that moves while the tool goes there; rest before the motion is cut off."""
    still, velocity = shown(count=200), np.array([0.03, 0.0, 0.0])
    late = minimum_jerk(still.times / 5.0)[:, None]
    points = still.points.copy()
    points[:, :3] += late * still.times[:, None] * velocity
    times = np.concatenate([np.arange(-1.0, 0.0, 0.025), still.times])
    points = np.concatenate([np.tile(points[0], (40, 1)), points])
    hole = SHOWN['goal'] + np.append(times[:, None] * velocity, np.zeros((240, 4)), axis=1)
    box = np.tile(SHOWN['start'], (240, 1))
    file = tmp_path / f'take.{kind}'
    if kind == 'npz':
        np.savez(file, time=times + 1.0, pose=points, box=box, hole_seen=hole)
    else:
        heads = ['time', *'xyz', 'qw', 'qx', 'qy', 'qz', *(
            f'{name}.{part}' for name in ('box', 'hole_seen')
            for part in ('x', 'y', 'z', 'qw', 'qx', 'qy', 'qz'))]
        np.savetxt(file, np.column_stack([times + 1.0, points, box, hole]), delimiter=',',
                   header=','.join(heads), comments='')
    settings = LearningSettings(60, stiffness='none', objects=('box', 'hole=hole_seen'),
                                moving=('hole',), ends=('box', 'hole'),
                                source=Import(quaternion='wxyz'))
    learned = skill_from_bags([file], settings)
    frames = learned.demonstrations[0].frames
    assert np.abs(frames['box'] - SHOWN['start']).max() < 1e-9
    first = frames['hole'][0][:3] - SHOWN['goal'][:3]
    assert np.linalg.norm(first) < 0.03 * 0.3  # where it was when the motion began
    end = Rollout(learned.skill, frames={'box': SHOWN['start'], 'hole': SHOWN['goal']}).sample(
        np.linspace(0.0, 8.0, 20)).points[-1]
    assert max(apart(end, compose(SHOWN['goal'], ENTERS))) < 3e-3
    with pytest.raises(DataError, match='no array cup, and no columns cup.x to cup.qz'):
        skill_from_bags([file], replace(settings, objects=('box', 'hole_seen', 'cup'), moving=()))


def test_what_is_said_of_objects_is_learned_and_shown(tmp_path):
    bag = record(tmp_path / 'take', shown(count=200), {'box': SHOWN['start'],
                                                       'cup': SHOWN['goal']})
    skill = tmp_path / 'skill.json'
    done = gdmp('learn', bag, '-o', skill, '--n-basis', 60, '--frames', 'box', 'cup',
                '--free-yaw', 'cup')
    assert done.returncode == 0, done.stderr
    replace(Skill.load(skill), views=[replace(view, grasped=grasped) for view, grasped in zip(
        Skill.load(skill).views, (0.4, None))]).save(skill)
    told = ' '.join(gdmp('show', skill).stdout.replace('│', ' ').split())  # a table, wrapped
    assert 'symmetric about its z axis' in told and 'grasped at s = 0.40' in told
    near = [f'{number:.9f}' for number in ELSEWHERE['goal']]
    lines = [gdmp('rollout', skill, '--object', 'cup', *near, '--dt', 0.5, '--object-scale',
                  scale).stdout.splitlines() for scale in ('none', 'distance')]
    ends = [np.array(one[-1].split(',')[2:], dtype=float) for one in lines]
    assert max(apart(*ends)) < 1e-3
    assert apart(ends[0], compose(ELSEWHERE['goal'], ENTERS))[0] < 1e-3


def test_a_frame_that_was_lost_is_an_error_with_the_time(tmp_path):
    bag = record(tmp_path / 'take', shown(count=200), {'start': SHOWN['start']}, {
        'goal': lambda time: None if 2.0 < time < 3.0 else SHOWN['goal']})
    recording = recordings.read(bag)
    known, _ = recordings.with_stiffness([recording], 'none')
    with pytest.raises(DataError, match=r'goal was lost for 1\.\d+ s at t = [12]\.\d+ s'):
        with_objects([recording], known, ['start', 'goal'], ['goal'])
    with pytest.raises(DataError, match="'cup' is declared moving"):
        with_objects([recording], known, ['start', 'goal'], ['cup'])
    with pytest.raises(DataError, match='no transforms lead from cup to base'):
        with_objects([recording], known, ['cup'])


def test_stiffness_from_variance_is_refused_among_objects(tmp_path):
    found = [record(tmp_path / f'take_{k}', shown(frames, count=200),
                    dict(zip(('start', 'goal'), frames.values())))
             for k, frames in enumerate((SHOWN, ELSEWHERE))]
    learned = skill_from_bags(found, LearningSettings(60, objects=('start', 'goal')))
    assert learned.skill.manifold == tool_manifold(None)
    with pytest.raises(ParameterError, match='takes vary where the objects do'):
        skill_from_bags(found, LearningSettings(60, objects=('start', 'goal'),
                                                stiffness='variance'))


def test_the_command_line_learns_among_objects_and_goes_where_they_are(tmp_path):
    bag = record(tmp_path / 'take', shown(count=200), {'box': SHOWN['start'],
                                                       'hole': SHOWN['goal']})
    skill = tmp_path / 'skill.json'
    done = gdmp('learn', bag, '-o', skill, '--n-basis', 60, '--frames', 'box', 'hole',
                '--start-frame', 'box')
    assert done.returncode == 0, done.stderr
    told = gdmp('show', skill).stdout
    assert 'task frame box' in told and 'matters most for s = 0.00 … 0.5' in told
    assert gdmp('show', skill, '-o', tmp_path / 'skill.png').returncode == 0
    assert drawn(tmp_path / 'skill.png') > 0.01
    goal = [f'{number:.9f}' for number in ELSEWHERE['goal']]
    told = gdmp('show', skill, '--object', 'hole', *goal)
    assert told.returncode == 0 and f'{ELSEWHERE["goal"][1]:.4g}' in told.stdout
    done = gdmp('rollout', skill, '--object', 'hole', *goal, '--dt', 0.5)
    last = np.array(done.stdout.splitlines()[-1].split(',')[2:], dtype=float)
    assert max(apart(last, compose(ELSEWHERE['goal'], ENTERS))) < 1e-3
    refused = gdmp('rollout', skill, '--object', 'cup', *goal)
    assert refused.returncode == 1 and 'expected one of box, hole' in refused.stderr
    refused = gdmp('check', skill, '--object', 'hole', *goal[:6], 'w')
    assert refused.returncode == 1 and 'are not 7 numbers' in refused.stderr

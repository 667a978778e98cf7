"""Recordings of joints are read as motions of the tool: names, units, fingers, other programs."""
import json

import numpy as np
import pytest

from gdmp_ros import DataError, GdmpWarning, Skill
from gdmp_ros.data import bags, recordings
from gdmp_ros.data.arm_joints import ArmJoints
from gdmp_ros.data.columns import Import
from gdmp_ros.data.skills import LearningSettings, skill_from_bags
from gdmp_ros.manifolds.quaternion import pose_distance
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.tip import from_model, from_urdf
from gdmp_ros.util.profiles import minimum_jerk
from test import urdf
from test.commands import gdmp

BEGINS = 1_700_000_000_000_000_000
#: An ordinary posture of a UR, and another one [rad].
FROM = np.array([0.2, -1.4, 1.6, -1.8, -1.57, 0.3])
TO = np.array([1.1, -1.0, 1.3, -1.9, -1.4, -2.5])


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp('arm') / 'ur5e.urdf'
    path.write_text(urdf.ur5e())
    return path


@pytest.fixture(scope='module')
def arm(file):
    return from_urdf(file, 'tool0')


def motion(count=300, seconds=4.0):
    times = np.linspace(0.0, seconds, count)
    way = minimum_jerk(times / seconds)[:, None]
    return times, FROM + way * (TO - FROM) + 0.1 * np.sin(np.pi * way)


def record(bag, times, positions, names=urdf.JOINTS, topic='/joint_states'):
    with bags.BagWriter(bag) as writer:
        for time, row in zip(times, positions):
            writer.joints(topic, BEGINS + round(time * bags.NS), names, row.tolist())
    return bag


def reading(arm, **said):
    return Import(joints=ArmJoints(arm), **said)


def same_points(recording, other):
    distance, angle = np.transpose([pose_distance(a, b) for a, b in zip(
        recording.demonstration.points, other.demonstration.points)])
    assert len(recording.demonstration.times) == len(other.demonstration.times)
    assert distance.max() < 1e-9 and angle.max() < 1e-7


def test_the_tool_of_a_urdf_is_where_denavit_and_hartenberg_have_it(file, rng):
    in_base = from_urdf(file, 'tool0', 'base')
    assert in_base.names == urdf.JOINTS and in_base.base == 'base' and in_base.turns.all()
    assert np.allclose(in_base.limits[2], [-np.pi, np.pi])
    positions = rng.uniform(-np.pi, np.pi, (50, 6))
    for position, pose in zip(positions, in_base.poses(positions)):
        assert max(pose_distance(pose, urdf.by_denavit_hartenberg(position))) < 1e-7
    # base_link is turned by half a turn against base.
    turned = from_urdf(file, 'tool0').poses(positions)
    assert np.abs(turned[:, :2] + in_base.poses(positions)[:, :2]).max() < 1e-9


def test_the_tool_of_a_model_is_that_of_the_arm():
    panda = Arm()
    positions = np.array([panda.home, panda.home + 0.2])
    found = from_model('panda').poses(positions)
    for pose, position in zip(found, positions):
        assert max(pose_distance(pose, panda.pose_at(position))) < 1e-9


def test_joints_and_poses_of_the_same_motion_make_the_same_skill(arm, tmp_path):
    times, positions = motion()
    poses = arm.poses(positions)
    with bags.BagWriter(tmp_path / 'poses') as writer:
        for time, pose in zip(times, poses):
            writer.pose('/pose', BEGINS + round(time * bags.NS), pose, 'base_link')
    record(tmp_path / 'joints', times, positions)
    by_poses, by_joints = (
        skill_from_bags([tmp_path / name], LearningSettings(40, source=said)).skill
        for name, said in (('poses', Import()), ('joints', reading(arm))))
    at = np.linspace(0.0, 5.0, 50)
    paths = [skill.rollout().sample(at).points for skill in (by_poses, by_joints)]
    assert np.abs(paths[0] - paths[1]).max() < 1e-9
    assert by_joints.provenance['frame'] == 'base_link'


def test_names_come_in_any_order_with_and_without_a_prefix(arm, tmp_path):
    times, positions = motion()
    plain = recordings.read(record(tmp_path / 'plain', times, positions), settings=reading(arm))
    order = [2, 1, 0, 3, 5, 4]  # as a UR publishes them
    mixed = record(tmp_path / 'mixed', times, positions[:, order],
                   [f'left_{urdf.JOINTS[i]}' for i in order])
    same_points(recordings.read(mixed, settings=reading(arm)), plain)
    missing = record(tmp_path / 'missing', times, positions[:, :5], urdf.JOINTS[:5])
    with pytest.raises(DataError, match="joint 'wrist_3' is missing"):
        recordings.read(missing, settings=reading(arm))
    with pytest.raises(DataError, match="joint 'shoulder_pan' is there 2 times"):
        recordings.read(record(tmp_path / 'two', times, np.hstack([positions, positions]), [
            f'{side}_{name}' for side in ('left', 'right') for name in urdf.JOINTS]),
            settings=reading(arm))


def test_other_joints_are_left_out_and_told(arm, tmp_path):
    times, positions = motion()
    plain = recordings.read(record(tmp_path / 'plain', times, positions), settings=reading(arm))
    more = record(tmp_path / 'more', times, np.hstack([positions, np.full((300, 1), 0.3)]),
                  [*urdf.JOINTS, 'lift'])
    with pytest.warns(GdmpWarning, match='lift are not joints of the arm: left out'):
        same_points(recordings.read(more, settings=reading(arm)), plain)


def test_fingers_are_learned_as_commands_of_the_gripper(arm, tmp_path):
    times, positions = motion()
    # Open; at 1 s they close on something of 20 mm; at 3 s they open.
    width = np.interp(times, [1.0, 1.5, 3.0, 3.4], [0.08, 0.02, 0.02, 0.08])
    fingers = np.stack([0.5 * width, 0.5 * width], axis=1)
    bag = record(tmp_path / 'pick', times, np.hstack([positions, fingers]),
                 [*urdf.JOINTS, 'finger_joint1', 'finger_joint2'])
    with pytest.warns(GdmpWarning, match='finger_joint1, finger_joint2 belong to a gripper'):
        found = recordings.read(bag, settings=reading(arm))
    closes, opens = found.events
    assert closes.force > 0.0 and closes.width == 0.0 and opens.force == 0.0
    assert opens.width == pytest.approx(0.08, abs=2e-3)
    begins = (found.begins - BEGINS) / bags.NS
    for event, time in ((closes, 1.0), (opens, 3.0)):
        at = begins + event.progress * found.demonstration.duration
        assert at == pytest.approx(time, abs=0.05)
    # A gripper that turns has no width in metres.
    bag = record(tmp_path / 'turns', times, np.hstack([positions, 10.0 * fingers[:, :1]]),
                 [*urdf.JOINTS, 'robotiq_left_knuckle_joint'])
    with pytest.warns(GdmpWarning, match='belong to a gripper'):
        assert recordings.read(bag, settings=reading(arm)).events == ()


def test_degrees_are_recognised_by_the_limits_and_the_names(arm, tmp_path):
    times, positions = motion()
    plain = recordings.read(record(tmp_path / 'plain', times, positions), settings=reading(arm))
    degrees = record(tmp_path / 'degrees', times, np.degrees(positions))
    with pytest.warns(GdmpWarning, match='the joints are in deg'):
        same_points(recordings.read(degrees, settings=reading(arm)), plain)
    same_points(recordings.read(degrees, settings=reading(arm, angle_unit='deg')), plain)
    table = tmp_path / 'degrees.csv'
    np.savetxt(table, np.column_stack([times, np.degrees(positions)]), delimiter=',', comments='',
               header=','.join(['time', *(f'{name} [deg]' for name in urdf.JOINTS)]))
    with pytest.warns(GdmpWarning, match='in deg'):
        same_points(recordings.read(table, settings=reading(arm)), plain)
    far = record(tmp_path / 'far', times, 1000.0 * positions)
    with pytest.raises(DataError, match='neither in rad nor in deg.*--units'):
        recordings.read(far, settings=reading(arm))


def test_a_joint_that_turns_on_and_on_is_wrapped(tmp_path):
    path = tmp_path / 'ur5e.urdf'
    path.write_text(urdf.ur5e(continuous=['wrist_3_joint']))
    arm = from_urdf(path, 'tool0')
    assert np.isinf(arm.limits[5]).all()
    times, positions = motion()
    positions[:, 5] = np.linspace(2.0, 4.5, 300)
    wrapped = positions.copy()
    wrapped[:, 5] = (wrapped[:, 5] + np.pi) % (2.0 * np.pi) - np.pi
    assert np.abs(np.diff(wrapped[:, 5])).max() > 6.0
    first, second = (recordings.read(record(tmp_path / name, times, rows), settings=reading(arm))
                     for name, rows in (('on', positions), ('wrapped', wrapped)))
    same_points(first, second)


def lerobot(folder, arm, times, rows, names):
    """A LeRobot data set, version 2.1, with positions of joints and a gripper."""
    pa, pq = pytest.importorskip('pyarrow'), pytest.importorskip('pyarrow.parquet')
    (folder / 'data' / 'chunk-000').mkdir(parents=True)
    (folder / 'meta').mkdir()
    part = {'dtype': 'float32', 'shape': [len(names)], 'names': list(names)}
    (folder / 'meta' / 'info.json').write_text(json.dumps({
        'codebase_version': 'v2.1', 'fps': 75, 'features': {
            'observation.state': part, 'action': part, 'timestamp': {'dtype': 'float32',
                                                                    'shape': [1], 'names': None},
            'episode_index': {'dtype': 'int64', 'shape': [1], 'names': None}}}))
    pq.write_table(pa.table({
        'observation.state': rows.tolist(), 'action': np.roll(rows, -1, axis=0).tolist(),
        'timestamp': times, 'episode_index': np.zeros(len(times), dtype=int)}),
        folder / 'data' / 'chunk-000' / 'episode_000000.parquet')
    return folder


def test_a_lerobot_set_is_in_degrees_or_percent_and_has_to_be_told(arm, tmp_path):
    times, positions = motion()
    plain = recordings.read(record(tmp_path / 'plain', times, positions), settings=reading(arm))
    names = [f'{name.removesuffix("_joint")}.pos' for name in urdf.JOINTS]
    with_gripper = [*names, 'gripper.pos']
    grip = np.full((300, 1), 30.0)
    degrees = lerobot(tmp_path / 'degrees', arm, times, np.hstack([np.degrees(positions), grip]),
                      with_gripper)
    # Above 100 it can be degrees only.
    with pytest.warns(GdmpWarning, match='gripper.pos is no joint of the arm'):
        same_points(recordings.read(degrees, settings=reading(arm)), plain)
    motors = {name.removesuffix('_joint'): {
        'id': i, 'drive_mode': i % 2, 'homing_offset': 0, 'range_min': 10 + i, 'range_max': 4080}
        for i, name in enumerate(urdf.JOINTS)}
    (tmp_path / 'motors.json').write_text(json.dumps(motors))
    spans = np.array([one['range_max'] - one['range_min'] for one in motors.values()])
    signs = np.array([-1.0 if one['drive_mode'] else 1.0 for one in motors.values()])
    rows = signs * positions / (2.0 * np.pi / 4095.0) / (0.5 * spans) * 100.0
    percent = lerobot(tmp_path / 'percent', arm, times, np.hstack([rows, grip]), with_gripper)
    with pytest.raises(DataError, match='may be deg, or percent .* --units'):
        recordings.read(percent, settings=reading(arm))
    with pytest.raises(DataError, match='give their --calibration'):
        recordings.read(percent, settings=reading(arm, angle_unit='percent'))
    told = Import(joints=ArmJoints(arm, tmp_path / 'motors.json'), angle_unit='percent')
    found = recordings.read(percent, settings=told)
    distance = np.linalg.norm(found.demonstration.points[:, :3]
                              - plain.demonstration.points[:, :3], axis=1)
    assert distance.max() < 1e-5  # the set has numbers of single precision
    for text in ('{}', '{"shoulder_pan": 3}', 'no json'):
        (tmp_path / 'motors.json').write_text(text)
        with pytest.raises(DataError, match='missing|no calibration of LeRobot'):
            recordings.read(percent, settings=told)


def test_arrays_of_joints_are_read_too(arm, tmp_path):
    times, positions = motion()
    plain = recordings.read(record(tmp_path / 'plain', times, positions), settings=reading(arm))
    np.savez(tmp_path / 'array.npz', time=times, joint_positions=positions)
    same_points(recordings.read(tmp_path / 'array.npz', settings=reading(arm)), plain)
    np.savez(tmp_path / 'q.npz', time=times, motion_data=positions)
    with pytest.raises(DataError, match='were not found; name their columns with --key joints='):
        recordings.read(tmp_path / 'q.npz', settings=reading(arm))
    same_points(recordings.read(tmp_path / 'q.npz', settings=reading(
        arm, keys={'joints': 'motion_data'})), plain)


def test_the_command_line_learns_converts_and_shows_joints(file, arm, tmp_path):
    times, positions = motion()
    bag = record(tmp_path / 'joints', times, positions)
    done = gdmp('learn', bag, '-o', tmp_path / 'skill.json', '--n-basis', 40, '--urdf', file,
                '--tip', 'tool0')
    assert done.returncode == 0, done.stderr
    skill = Skill.load(tmp_path / 'skill.json')
    assert max(pose_distance(skill.goal[:7], arm.poses(positions[-1:])[0])) < 5e-3
    done = gdmp('convert', bag, '-o', tmp_path / 'motion.csv', '--urdf', file, '--tip', 'tool0')
    assert done.returncode == 0, done.stderr
    rows = np.loadtxt(tmp_path / 'motion.csv', delimiter=',', skiprows=1)
    assert np.linalg.norm(rows[-1, 1:4] - arm.poses(positions[-1:])[0, :3]) < 1e-3
    for words, reason in ((['--urdf', file], '--urdf needs --tip'),
                          (['--tip', 'tool0'], '--tip is for --urdf or --joints-of'),
                          (['--urdf', file, '--tip', 'gripper'], "there is no link 'gripper'"),
                          (['--urdf', file, '--tip', 'tool0', '--base', 'wrist_9'], 'wrist_9'),
                          (['--joints-of', 'panda'], "joint 'joint1' is missing")):
        done = gdmp('learn', bag, '-o', tmp_path / 'no.json', *words)
        assert done.returncode == 1 and reason in done.stderr, done.stderr
    assert not (tmp_path / 'no.json').exists()


def test_the_model_of_the_picture_shows_joints_where_no_pose_was_recorded(tmp_path):
    panda = Arm()
    times = np.linspace(0.0, 2.0, 200)
    positions = panda.home + 0.3 * minimum_jerk(times / 2.0)[:, None]
    names = [f'panda_joint{i}' for i in range(1, 8)]
    bag = record(tmp_path / 'joints', times, positions, names)
    done = gdmp('show', bag, '--model', 'panda')
    assert done.returncode == 0 and 'no topic holds a pose' not in done.stdout, done.stderr
    plain = ' '.join(gdmp('show', bag).stdout.split())
    assert 'no topic holds a pose' in plain and 'with --urdf FILE --tip LINK' in plain
    # Where poses were recorded, these are shown.
    with bags.BagWriter(tmp_path / 'both') as writer:
        for time, row in zip(times, positions):
            stamp = BEGINS + round(time * bags.NS)
            writer.joints('/joint_states', stamp, names, row.tolist())
            writer.pose('/pose', stamp, [time, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], 'base')
    settings = Import(joints=ArmJoints(from_model('panda'), if_needed=True))
    found = recordings.read(tmp_path / 'both', settings=settings)
    assert found.frame == 'base' and found.demonstration.points[-1, 0] == pytest.approx(2.0)


@pytest.mark.parametrize(('text', 'reason'), [
    ('<robot', 'not XML'), ('<sdf/>', 'begins with <sdf>'), ('<robot/>', 'have no parent'),
    ('<robot xmlns:xacro="x"><xacro:macro/></robot>', 'xacro file'),
    ('<robot><link name="a"/><link name="b"/></robot>', 'a, b have no parent')])
def test_what_is_no_urdf_is_named(tmp_path, text, reason):
    (tmp_path / 'robot.urdf').write_text(text)
    with pytest.raises(DataError, match=reason):
        from_urdf(tmp_path / 'robot.urdf', 'tool0')
    with pytest.raises(DataError, match='nowhere.urdf'):
        from_urdf(tmp_path / 'nowhere.urdf', 'tool0')

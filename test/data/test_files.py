"""Files as people have them: each is read right, or refused with the option that is needed."""
import gzip

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import get_typestore, Stores
from scipy.spatial.transform import Rotation

from gdmp_ros import Skill
from gdmp_ros.cli.main import main
from gdmp_ros.data import bags, episodes, recordings
from gdmp_ros.data.columns import Import, increasing
from gdmp_ros.errors import DataError

RATE_HZ, SECONDS = 100.0, 2.0
QUATERNION = 'qx', 'qy', 'qz', 'qw'


class Truth:
    """A reach with a turn of the tool, which points down, in metres and seconds."""

    times = np.arange(round(SECONDS * RATE_HZ) + 1) / RATE_HZ
    _s = times / SECONDS
    _rise = _s ** 3 * (10.0 - 15.0 * _s + 6.0 * _s ** 2)
    position = np.array([0.42, -0.21, 0.35]) + np.outer(_rise, [0.11, 0.35, -0.13])
    rotation = Rotation.from_euler('xyz', [np.pi - 0.4, 0.1, 0.3]) * Rotation.from_rotvec(
        np.outer(_rise, [0.5, -0.3, 0.9]))
    xyzw = rotation.as_quat()
    wxyz = np.roll(xyzw, 1, axis=1)
    rpy = rotation.as_euler('xyz')
    rotvec = rotation.as_rotvec()
    matrices = np.tile(np.eye(4), (len(times), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = rotation.as_matrix(), position


T = Truth
ROWS = np.column_stack([T.times, T.position, T.wxyz])
NAMES = ['time', 'x', 'y', 'z', 'qw', 'qx', 'qy', 'qz']


def text(names, columns, delimiter=',', comma=False, form='{:.9f}'):
    """A table as text."""
    lines = [delimiter.join(names)] if names else []
    for row in columns:
        cells = [cell if isinstance(cell, str) else form.format(cell) for cell in row]
        lines.append(delimiter.join(cell.replace('.', ',') if comma else cell for cell in cells))
    return '\n'.join(lines) + '\n'


def scaled(time=1.0, length=1.0, epoch=0.0):
    rows = ROWS.copy()
    rows[:, 0] = epoch + time * rows[:, 0]
    rows[:, 1:4] *= length
    return rows


def stacked(*parts):
    return np.column_stack(parts)


def integers(factor, epoch):
    return [[str(epoch + round(factor * row[0])), *row[1:]] for row in ROWS]


def with_row(at, row):
    rows = ROWS.tolist()
    rows[at] = [*row, *rows[at][len(row):]]
    return rows


def swapped():
    rows = ROWS.tolist()
    rows[50][0], rows[51][0] = rows[51][0], rows[50][0]
    return rows


MOTIVE = (
    'Format Version,1.23,Take Name,reach,Capture Frame Rate,100.0,Length Units,{unit},'
    'Coordinate Space,Global\n\n'
    ',Type,' + ','.join(['Rigid Body'] * 7) + '\n'
    ',Name,' + ','.join(['tool'] * 7) + '\n'
    ',ID,' + ','.join(['1'] * 7) + '\n'
    ',,Rotation,Rotation,Rotation,Rotation,Position,Position,Position\n'
    'Frame,Time (Seconds),X,Y,Z,W,X,Y,Z\n')
TUM = stacked(T.times + 1.7e9, T.position, T.xyzw)
FLIPPED = T.xyzw * np.sign(T.xyzw[:, 3:] - 1e-12)
# Sign changes where w passes zero.
TURNING = Rotation.from_rotvec(np.outer(T._rise, [0.0, 0.0, 2.0 * np.pi * 0.9])).as_quat()
TURNING *= np.where(TURNING[:, 3:] < 0.0, -1.0, 1.0)
#: Name of a file: its text, and what is said about it.
READ = {
    'own.csv': (text(NAMES, ROWS), {}),
    'ms.csv': (text(NAMES, scaled(1e3)), {}),
    'us.csv': (text(NAMES, scaled(1e6)), {}),
    'ns.csv': (text(NAMES, integers(1e9, 1_700_000_000_000_000_000)), {}),
    'epoch.csv': (text(NAMES, scaled(1.0, 1.0, 1.7e9)), {}),
    'named_ms.csv': (text(['time_ms', *NAMES[1:]], scaled(1e3)), {}),
    'named_us.csv': (text(['t_us', *NAMES[1:]], scaled(1e6)), {}),
    'named_ns.csv': (text(['timestamp_ns', *NAMES[1:]], scaled(1e9)), {}),
    'bracket.csv': (text(['t [ms]', 'x [mm]', 'y [mm]', 'z [mm]', *NAMES[4:]],
                         scaled(1e3, 1e3)), {}),
    'parenthesis.csv': (text(['Time (s)', 'X (m)', 'Y (m)', 'Z (m)', *NAMES[4:]], ROWS), {}),
    'x_m.csv': (text(['time_s', 'x_m', 'y_m', 'z_m', *NAMES[4:]], ROWS), {}),
    'x_mm.csv': (text(['t', 'x_mm', 'y_mm', 'z_mm', *NAMES[4:]], scaled(1.0, 1e3)), {}),
    'mm.csv': (text(NAMES, scaled(1.0, 1e3)), {}),
    'x_cm.csv': (text(['t', 'x_cm', 'y_cm', 'z_cm', *NAMES[4:]], scaled(1.0, 1e2)), {}),
    'cm.csv': (text(NAMES, scaled(1.0, 1e2)), {'scale': 0.01}),
    'semicolon.csv': (text(NAMES, ROWS, ';'), {}),
    'decimal_comma.csv': (text(NAMES, ROWS, ';', True), {}),
    'decimal_comma.txt': (text(NAMES, ROWS, '\t', True), {}),
    'comma_space.csv': (text(NAMES, ROWS, ', '), {}),
    'tabs.tsv': (text(NAMES, ROWS, '\t'), {}),
    'spaces.txt': (text(NAMES, ROWS, '   '), {}),
    'bom.csv': ('\ufeff' + text(NAMES, ROWS), {}),
    'blank_lines.csv': (text(NAMES, ROWS).replace('\n', '\n\n'), {}),
    'windows.csv': (text(NAMES, ROWS).replace('\n', '\r\n'), {}),
    'comment.csv': ('# recorded on Monday\n' + text(NAMES, ROWS), {}),
    'hash_heading.csv': ('# ' + text(NAMES, ROWS), {}),
    'quoted.csv': (text([f'"{name}"' for name in NAMES], ROWS), {}),
    'tum.txt': ('# timestamp tx ty tz qx qy qz qw\n' + text([], TUM, ' '), {}),
    'evo.tum': (text([], TUM, ' '), {}),
    'euroc.csv': (
        '#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], '
        'q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1]\n'
        + text([], [[*row, '0.1', '0.2', '0.3'] for row in integers(
            1e9, 1_403_636_580_838_555_648)]), {}),
    'motive.csv': (MOTIVE.format(unit='Meters') + text(
        [], [[str(i), *row] for i, row in enumerate(stacked(T.times, T.xyzw, T.position))]), {}),
    'motive_mm.csv': (MOTIVE.format(unit='Millimeters') + text(
        [], [[str(i), *row] for i, row in enumerate(
            stacked(T.times, T.xyzw, 1e3 * T.position))]), {}),
    'ros_names.csv': (text(
        ['header.stamp.sec', 'header.stamp.nanosec', *(f'pose.position.{a}' for a in 'xyz'),
         *(f'pose.orientation.{a}' for a in 'xyzw')],
        [[str(1_700_000_000 + round(1e9 * t) // 10 ** 9), str(round(1e9 * t) % 10 ** 9), *p, *q]
         for t, p, q in zip(T.times, T.position, T.xyzw)]), {}),
    'sec_nsec.csv': (text(
        ['sec', 'nsec', 'x', 'y', 'z', *QUATERNION],
        [[str(1_700_000_000 + round(1e9 * t) // 10 ** 9), str(round(1e9 * t) % 10 ** 9), *p, *q]
         for t, p, q in zip(T.times, T.position, T.xyzw)]), {}),
    'rostopic.csv': (text(
        ['%time', 'field.header.seq', 'field.header.stamp', 'field.header.frame_id',
         *(f'field.pose.position.{a}' for a in 'xyz'),
         *(f'field.pose.orientation.{a}' for a in 'xyzw')],
        [[str(1_700_000_000_000_000_000 + round(1e9 * t)), str(i),
          str(1_700_000_000_000_000_000 + round(1e9 * t)), 'base', *p, *q]
         for i, (t, p, q) in enumerate(zip(T.times, T.position, T.xyzw))]), {}),
    'bagpy.csv': (text(
        ['Time', 'header.seq', 'header.stamp.secs', 'header.stamp.nsecs', 'header.frame_id',
         *(f'pose.position.{a}' for a in 'xyz'), *(f'pose.orientation.{a}' for a in 'xyzw')],
        [[f'{1.7e9 + t:.9f}', str(i), str(1_700_000_000 + round(1e9 * t) // 10 ** 9),
          str(round(1e9 * t) % 10 ** 9), 'base', *p, *q]
         for i, (t, p, q) in enumerate(zip(T.times, T.position, T.xyzw))]), {}),
    'pandas_index.csv': (text(['', *NAMES], [[str(i), *row] for i, row in enumerate(ROWS)]), {}),
    'evo_index.csv': (text(['', 'x', 'y', 'z', *QUATERNION], TUM), {}),
    'datetime.csv': (text(['timestamp', *NAMES[1:]], [
        [str(np.datetime64('2026-03-01T12:00:00.000000') + round(1e6 * row[0])), *row[1:]]
        for row in ROWS]), {}),
    'datetime_index.csv': (text(['', *NAMES[1:]], [
        [str(np.datetime64('2026-03-01T12:00:00.000000') + round(1e6 * row[0])), *row[1:]]
        for row in ROWS]), {}),
    'datetime_zone.csv': (text(['date', *NAMES[1:]], [
        [str(np.datetime64('2026-03-01T12:00:00.000') + round(1e3 * row[0])) + 'Z', *row[1:]]
        for row in ROWS]), {'keys': {'times': 'date'}}),
    'rpy.csv': (text(['t', 'x', 'y', 'z', 'roll', 'pitch', 'yaw'],
                     stacked(T.times, T.position, T.rpy)), {}),
    'rpy_deg.csv': (text(['t', 'x', 'y', 'z', 'roll_deg', 'pitch_deg', 'yaw_deg'],
                         stacked(T.times, T.position, np.degrees(T.rpy))), {}),
    'rpy_large.csv': (text(['t', 'x', 'y', 'z', 'roll', 'pitch', 'yaw'],
                           stacked(T.times, T.position, np.degrees(T.rpy))), {}),
    'euler.csv': (text(['t', 'tx', 'ty', 'tz', 'euler_x', 'euler_y', 'euler_z'],
                       stacked(T.times, T.position, T.rpy)), {'rotation': 'xyz'}),
    'quaternion_and_rpy.csv': (text(['t', 'x', 'y', 'z', *QUATERNION, 'roll', 'pitch', 'yaw'],
                                    stacked(T.times, T.position, T.xyzw, T.rpy)), {}),
    'rpy_angle_unit.csv': (text(['t', 'x', 'y', 'z', 'roll', 'pitch', 'yaw'],
                                stacked(T.times, T.position, T.rpy)), {'angle_unit': 'rad'}),
    'ox.csv': (text(['t', 'px', 'py', 'pz', 'ox', 'oy', 'oz', 'ow'],
                    stacked(T.times, T.position, T.xyzw)), {}),
    'setpoint.csv': (text([*NAMES, 'setpoint_x', 'setpoint_y', 'setpoint_z'],
                          stacked(ROWS, T.position + 0.1)), {}),
    'rotvec.csv': (text(['t', 'x', 'y', 'z', 'rotvec_x', 'rotvec_y', 'rotvec_z'],
                        stacked(T.times, T.position, T.rotvec)), {}),
    'ur.csv': (text(['t', 'x', 'y', 'z', 'rx', 'ry', 'rz'],
                    stacked(T.times, T.position, T.rotvec)), {'rotation': 'rotvec'}),
    'lerobot_names.csv': (text(
        ['timestamp', 'ee.x', 'ee.y', 'ee.z', 'ee.wx', 'ee.wy', 'ee.wz', 'ee.gripper_pos'],
        stacked(T.times, T.position, T.rotvec, T.times)), {}),
    'imu.csv': (text(['t', 'accel_x', 'accel_y', 'accel_z', 'x', 'y', 'z', *QUATERNION],
                     stacked(T.times, 9.0 * T.position, T.position, T.xyzw)), {}),
    'wrench.csv': (text(['t', 'x', 'y', 'z', *QUATERNION, 'fx', 'fy', 'fz', 'tx', 'ty', 'tz'],
                        stacked(T.times, T.position, T.xyzw, T.position, T.rpy)), {}),
    'velocity.csv': (text(['t', 'x', 'y', 'z', *QUATERNION, 'vx', 'vy', 'vz', 'wx', 'wy', 'wz'],
                          stacked(T.times, T.position, T.xyzw, T.position, T.rpy)), {}),
    'numbered.csv': (text(['t', 'pos_0', 'pos_1', 'pos_2', 'q0', 'q1', 'q2', 'q3'], ROWS),
                     {'quaternion': 'wxyz'}),
    'numbered_from_1.csv': (text(['t', 'p1', 'p2', 'p3', 'q1', 'q2', 'q3', 'q4'], ROWS),
                            {'quaternion': 'wxyz'}),
    'capitals.csv': (text(['Timestamp', 'PosX', 'PosY', 'PosZ', 'QuatW', 'QuatX', 'QuatY',
                           'QuatZ'], ROWS), {}),
    'two_tools.csv': (text(['t', *(f'cup_{n}' for n in NAMES[1:]), *(f'tcp_{n}' for n in
                                                                     NAMES[1:])],
                           stacked(ROWS, ROWS[:, 1:])), {}),
    'rate.csv': (text(NAMES[1:], ROWS[:, 1:]), {'rate_hz': RATE_HZ}),
    'rate_beside_times.csv': (text(NAMES, scaled(0.3)), {'rate_hz': RATE_HZ}),
    'time_unit.csv': (text(NAMES, scaled(1e3)), {'time_unit': 'ms'}),
    'nan.csv': (text(NAMES, with_row(70, [0.7, float('nan')])), {'drop_bad': True}),
    'empty_cell.csv': (text(NAMES, with_row(70, [0.7, ''])), {'drop_bad': True}),
    'duplicate_stamp.csv': (text(NAMES, with_row(70, [0.69])), {'drop_bad': True}),
    'swapped_stamps.csv': (text(NAMES, swapped()), {'drop_bad': True}),
    'far_stamp.csv': (text(NAMES, with_row(70, [1e6])), {'drop_bad': True}),
    'duplicate_columns.csv': (text([*NAMES, *NAMES[1:]], stacked(ROWS, ROWS[:, 1:] + 0.0)),
                              {'keys': {'position': 'x,y,z'}}),
    'label_column.csv': (text([*NAMES, 'phase'], [[*row, 'reach'] for row in ROWS]), {}),
}
#: Name of a file: its text or arrays, what is said about it, and what the error says.
REFUSED = {
    'cm.csv': (text(NAMES, scaled(1.0, 1e2)), {}, '--scale'),
    'numbered.csv': (READ['numbered.csv'][0], {}, '--quaternion'),
    'euler.csv': (READ['euler.csv'][0], {}, '--rotation'),
    'ur.csv': (READ['ur.csv'][0], {}, '--rotation'),
    'small_angles.csv': (text(['t', 'x', 'y', 'z', 'roll', 'pitch', 'yaw'],
                              stacked(T.times, T.position, 1.5 * T.rpy)), {}, '--angle-unit'),
    'mixed_units.csv': (text(['t', 'x_mm', 'y', 'z', *NAMES[4:]], ROWS), {}, 'expected one'),
    'far.csv': (text(NAMES, scaled(1.0, 1e6)), {}, '--scale'),
    'no_times.csv': (text(NAMES[1:], ROWS[:, 1:]), {}, '--rate-hz'),
    # 101 samples that are 1 apart: 0.4 m in 100 s, or in 0.1 s.
    'two_units.csv': (text(NAMES, [[float(i), *row[1:]] for i, row in enumerate(
        scaled(1.0, 0.5)[::2])]), {}, 's and ms fit a recording: give --time-unit'),
    'nan.csv': (READ['nan.csv'][0], {}, r'sample 70: a number is missing.*--drop-bad'),
    'duplicate_stamp.csv': (READ['duplicate_stamp.csv'][0], {},
                            'sample 70: time does not increase.*--drop-bad'),
    'duplicate_columns.csv': (READ['duplicate_columns.csv'][0], {}, 'x#2.*--key position'),
    'pandas_columns.csv': (text([*NAMES, *(f'{n}.1' for n in NAMES[1:])],
                                stacked(ROWS, ROWS[:, 1:])), {}, 'x#2.*--key position'),
    'two_bodies.csv': (text(['t', *(f'cup_{n}' for n in NAMES[1:]), *(f'can_{n}' for n in
                                                                      NAMES[1:])],
                            stacked(ROWS, ROWS[:, 1:])), {}, '--key position=cup_x,cup_y,cup_z'),
    'joints.csv': (text(['t', *(f'joint_{i}' for i in range(1, 8))],
                        stacked(T.times, T.wxyz, T.rpy)), {}, '--joints'),
    'motors.csv': (text(['t', *(f'motor_{i}' for i in range(7))],
                        stacked(T.times, T.position, T.wxyz)), {}, '--joints'),
    'position.csv': (text(NAMES[:4], ROWS[:, :4]), {}, 'no orientation'),
    'norm.csv': (text(NAMES, with_row(70, [0.7, 0.4, 0.1, 0.3, 0.9])), {},
                 'the norm of sample 70 is'),
    'short_line.csv': (text(NAMES, ROWS) + '1,2,3\n', {}, 'line 203: 3 numbers, expected 8'),
    'no_heading.csv': (text([], ROWS), {}, 'expected the names of the columns'),
    'empty.csv': ('', {}, 'there is nothing in it'),
    'heading.csv': ('t,x,y,z\n', {}, "no row of numbers below the heading 't x y z'"),
    'binary.csv': ('a\0b', {}, 'it is no text'),
    'word.docx': ('x', {}, 'format not read'),
}
ARRAYS = {
    'own': ({'times': T.times, 'points': ROWS[:, 1:]}, {}),
    'named_order': ({'t': T.times, 'tcp_pos': T.position, 'tcp_quat_wxyz': T.wxyz}, {}),
    'named_xyzw': ({'t': T.times, 'ee_pos': T.position, 'ee_quat_xyzw': T.xyzw}, {}),
    'pose_xyzw': ({'t': T.times, 'pose': stacked(T.position, T.xyzw)}, {'quaternion': 'xyzw'}),
    'quat': ({'t': T.times, 'pos': T.position, 'quat': T.wxyz}, {'quaternion': 'wxyz'}),
    'transposed': ({'t': T.times, 'pos': T.position.T, 'quat': T.xyzw.T},
                   {'quaternion': 'xyzw'}),
    'recorded': ({'recorded_traj': T.position.T, 'recorded_ori': T.wxyz.T},
                 {'quaternion': 'wxyz', 'rate_hz': RATE_HZ}),
    'matrices': ({'time': T.times, 'O_T_EE': T.matrices}, {'keys': {'points': 'O_T_EE'}}),
    'poses': ({'time': T.times, 'poses': T.matrices}, {}),
    'column_major': ({'time': T.times, 'poses': T.matrices.transpose(0, 2, 1).reshape(-1, 16)},
                     {}),
    'upper_rows': ({'time': T.times, 'poses': T.matrices[:, :3]}, {}),
    'rotation': ({'time': T.times, 'position': T.position,
                  'rotation': T.matrices[:, :3, :3]}, {}),
    'rotvec': ({'time': T.times, 'position': T.position, 'rotvec': T.rotvec}, {}),
    'rpy': ({'time': T.times, 'position': T.position, 'rpy': T.rpy}, {}),
    'stamps_ns': ({'stamps': np.int64(1.7e18) + (1e9 * T.times).round().astype(np.int64),
                   'position': T.position, 'quat_wxyz': T.wxyz}, {}),
    'dates': ({'time': np.datetime64('2026-01-01', 'ns') + (1e9 * T.times).round().astype(
        'timedelta64[ns]'), 'position': T.position, 'quat_wxyz': T.wxyz}, {}),
    'named_columns': ({'data': ROWS, 'columns': np.array(NAMES)}, {}),
    'float32': ({'time': T.times.astype(np.float32), 'pos': T.position.astype(np.float32),
                 'quat_xyzw': T.xyzw.astype(np.float32)}, {}),
}
REFUSED_ARRAYS = {
    'pose': ({'t': T.times, 'pose': stacked(T.position, T.xyzw)}, {}, '--quaternion'),
    'quat': ({'t': T.times, 'pos': T.position, 'quat': T.wxyz}, {}, '--quaternion'),
    'lengths': ({'t': T.times, 'pos': T.position[:50], 'quat_wxyz': T.wxyz}, {}, '50, 201'),
    'nothing': ({'a': T.times}, {}, '--key points=NAME'),
}


def check(found, exact=1e-6):
    """The motion is that of the truth."""
    kept = np.round(found.times * RATE_HZ).astype(int)
    assert found.duration == pytest.approx(SECONDS, abs=1e-5) and len(kept) >= 198
    np.testing.assert_allclose(found.times, T.times[kept], atol=1e-6)
    np.testing.assert_allclose(found.points[:, :3], T.position[kept], atol=exact)
    same = np.abs((found.points[:, 3:7] * T.wxyz[kept]).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=exact)


@pytest.mark.parametrize('name', READ)
def test_text_is_read(name, tmp_path):
    content, said = READ[name]
    path = tmp_path / name
    path.write_text(content, newline='')
    check(episodes.read(path, Import(**said)).demonstration)


@pytest.mark.parametrize('name', REFUSED)
def test_text_is_refused_with_the_option(name, tmp_path):
    content, said, reason = REFUSED[name]
    path = tmp_path / name
    path.write_text(content, newline='')
    with pytest.raises(DataError, match=reason):
        episodes.read(path, Import(**said))


@pytest.mark.parametrize('name', ARRAYS)
def test_arrays_are_read(name, tmp_path):
    arrays, said = ARRAYS[name]
    np.savez(tmp_path / 'a.npz', **arrays)
    check(episodes.read(tmp_path / 'a.npz', Import(**said)).demonstration)


@pytest.mark.parametrize('name', REFUSED_ARRAYS)
def test_arrays_are_refused_with_the_option(name, tmp_path):
    arrays, said, reason = REFUSED_ARRAYS[name]
    np.savez(tmp_path / 'a.npz', **arrays)
    with pytest.raises(DataError, match=reason):
        episodes.read(tmp_path / 'a.npz', Import(**said))


def test_other_containers_are_read(tmp_path):
    with gzip.open(tmp_path / 'a.csv.gz', 'wt') as out:
        out.write(text(NAMES, ROWS))
    np.save(tmp_path / 'named.npy', np.array([tuple(row) for row in ROWS], dtype=[
        (name, float) for name in NAMES]))
    np.save(tmp_path / 'pose.npy', ROWS[:, 1:])
    check(episodes.read(tmp_path / 'a.csv.gz').demonstration)
    check(episodes.read(tmp_path / 'named.npy').demonstration)
    said = Import({'points': 'pose'}, 'wxyz', rate_hz=RATE_HZ)
    check(episodes.read(tmp_path / 'pose.npy', said).demonstration)


@pytest.mark.parametrize('real, order', [(0, 'wxyz'), (3, 'xyzw')])
def test_the_order_is_told_by_a_change_of_all_signs(real, order, tmp_path):
    """A program that keeps the real part positive turns the tool further than half round."""
    rows = np.roll(TURNING, 1, axis=1) if real == 0 else TURNING
    np.savez(tmp_path / 'a.npz', t=T.times, pos=T.position, quat=rows)
    found = episodes.read(tmp_path / 'a.npz')
    assert any(f'quaternions in quat are {order}: all signs change' in note
               for note in found.notes)
    same = np.abs((found.demonstration.points[:, 3:] * np.roll(TURNING, 1, axis=1)).sum(axis=1))
    np.testing.assert_allclose(same, 1.0, atol=1e-9)


@pytest.mark.parametrize('rate, unit', [(1.0, 's'), (0.5, 's'), (2000.0, 's'), (2000.0, 'ms'),
                                        (1000.0, 'ms'), (2000.0, 'us'), (30.0, 'ns')])
def test_the_unit_of_times_is_found_at_any_rate(rate, unit, tmp_path):
    seconds = 60.0 if rate <= 1.0 else 2.0
    times = np.arange(int(seconds * rate) + 1) / rate
    at = times / seconds * SECONDS
    rows = np.column_stack([{'s': 1.0, 'ms': 1e3, 'us': 1e6, 'ns': 1e9}[unit] * times, *(
        np.interp(at, T.times, column) for column in ROWS[:, 1:].T)])
    rows[:, 4:] /= np.linalg.norm(rows[:, 4:], axis=1, keepdims=True)
    (tmp_path / 'a.csv').write_text(text(NAMES, rows))
    found = episodes.read(tmp_path / 'a.csv')
    assert found.demonstration.duration == pytest.approx(seconds, rel=1e-6)
    assert any(f'time [{unit}]' in note for note in found.notes)


def test_joints_are_read_and_unwrapped(tmp_path):
    turns = np.linspace(2.8, 3.6, len(T.times))
    joints = np.column_stack([np.mod(turns + np.pi, 2.0 * np.pi) - np.pi, T.rpy, T.rpy])
    names = ['t', *(f'joint_{i}' for i in range(1, 8)), 'finger_joint1']
    (tmp_path / 'a.csv').write_text(text(names, stacked(T.times, joints, T.times)))
    found = episodes.read_joints(tmp_path / 'a.csv')
    joint_names = found.joints
    assert joint_names == tuple(names[1:8])
    np.testing.assert_allclose(found.demonstration.points[:, 0], turns, atol=1e-6)
    assert any('joint_1 pass from pi to -pi' in note for note in found.notes)
    names = ['timestamp', 'shoulder_pan.pos', 'elbow_flex.pos', 'gripper.pos']
    (tmp_path / 'b.csv').write_text(text(names, stacked(
        T.times, np.degrees(T.rpy[:, :2]), T.times)))
    found = episodes.read_joints(tmp_path / 'b.csv')
    joint_names = found.joints
    np.testing.assert_allclose(found.demonstration.points, T.rpy[:, :2], atol=1e-6)
    assert joint_names == ('shoulder_pan.pos', 'elbow_flex.pos')
    assert any('gripper.pos is no joint' in note for note in found.notes)


def test_a_gripper_beside_a_pose_is_told(tmp_path):
    (tmp_path / 'a.csv').write_text(text([*NAMES, 'gripper.pos'], stacked(ROWS, T.times)))
    assert 'not used: gripper.pos' in episodes.read(tmp_path / 'a.csv').notes


@pytest.mark.parametrize('times, kept', [
    ([0, 1, 9, 2, 3, 4], [1, 1, 0, 1, 1, 1]), ([0, 1, 2, 2, 3], [1, 1, 0, 0, 1]),
    ([0, 1, 3, 2, 4], [1, 1, 0, 0, 1]), ([5, 0, 1, 2, 3], [0, 1, 1, 1, 1])])
def test_of_samples_that_contradict_each_other_none_is_kept(times, kept):
    np.testing.assert_array_equal(increasing(np.array(times, dtype=float)), kept)


def test_the_command_learns_or_names_the_option(tmp_path, capsys):
    for name in ('decimal_comma.csv', 'tum.txt', 'nan.csv', 'euler.csv'):
        (tmp_path / name).write_text(READ[name][0])
    for name, words in (('decimal_comma.csv', []), ('tum.txt', []), ('nan.csv', ['--drop-bad']),
                        ('euler.csv', ['--rotation', 'xyz'])):
        skill = tmp_path / f'{name}.json'
        assert main(['learn', str(tmp_path / name), '-o', str(skill), *words]) == 0
        learned = Skill.load(skill)
        np.testing.assert_allclose(learned.goal[:3], T.position[-1], atol=2e-3)
        assert abs(learned.goal[3:7] @ T.wxyz[-1]) == pytest.approx(1.0, abs=1e-5)
        assert 1.5 < learned.duration <= SECONDS
    capsys.readouterr()
    assert main(['learn', str(tmp_path / 'nan.csv'), '-o', str(tmp_path / 'no.json')]) == 1
    assert '--drop-bad' in capsys.readouterr().err and not (tmp_path / 'no.json').exists()


STORE = get_typestore(Stores.ROS2_JAZZY)
START = 1_700_000_000 * bags.NS


def message(kind, **fields):
    return STORE.types[kind](**fields)


def header(i, frame='base', start=START):
    stamp = start + round(1e9 * T.times[i])
    return message('std_msgs/msg/Header', frame_id=frame, stamp=message(
        'builtin_interfaces/msg/Time', sec=stamp // bags.NS, nanosec=stamp % bags.NS))


def pose_message(i):
    x, y, z, w = T.xyzw[i]
    return message('geometry_msgs/msg/Pose',
                   position=message('geometry_msgs/msg/Point', **dict(zip('xyz', T.position[i]))),
                   orientation=message('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w))


def transform(i, tool='tool0', base='base', moved=True):
    x, y, z, w = T.xyzw[i] if moved else (0.0, 0.0, 0.0, 1.0)
    position = T.position[i] if moved else np.zeros(3)
    return message('geometry_msgs/msg/TransformStamped', header=header(i, base),
                   child_frame_id=tool, transform=message(
                       'geometry_msgs/msg/Transform',
                       translation=message('geometry_msgs/msg/Vector3', **dict(
                           zip('xyz', position))),
                       rotation=message('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)))


def stamped(i, **options):
    return message(bags.POSE, header=header(i, **options), pose=pose_message(i))


def covariance(i):
    return message('geometry_msgs/msg/PoseWithCovariance', pose=pose_message(i),
                   covariance=np.zeros(36))


def odometry(i):
    vector = message('geometry_msgs/msg/Vector3', x=0.0, y=0.0, z=0.0)
    twist = message('geometry_msgs/msg/TwistWithCovariance', covariance=np.zeros(36),
                    twist=message('geometry_msgs/msg/Twist', linear=vector, angular=vector))
    return message('nav_msgs/msg/Odometry', header=header(i), child_frame_id='tool',
                   pose=covariance(i), twist=twist)


def joint_state(i, names, positions):
    empty = np.empty(0)
    return message(bags.JOINTS, header=header(i, ''), name=names, velocity=empty, effort=empty,
                   position=np.asarray(positions, dtype=float))


def written(path, topics, storage='mcap'):
    """A bag: of each topic its type, and a function that gives the message of a sample."""
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer:
        for topic, (kind, of_sample) in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for i in range(len(T.times)):
                for item in of_sample(i) if isinstance(of_sample(i), list) else [of_sample(i)]:
                    writer.write(connection, START + round(1e9 * T.times[i]),
                                 STORE.serialize_cdr(item, kind))
    return path


BAGS = {
    'transform': {'/tool': (bags.TRANSFORM, transform)},
    'odometry': {'/odom': ('nav_msgs/msg/Odometry', odometry)},
    'pose': {'/pose': ('geometry_msgs/msg/Pose', pose_message)},
    'covariance': {'/pose': ('geometry_msgs/msg/PoseWithCovarianceStamped', lambda i: message(
        'geometry_msgs/msg/PoseWithCovarianceStamped', header=header(i), pose=covariance(i)))},
    'path': {'/path': (bags.PATH, lambda i: message(
        bags.PATH, header=header(i), poses=[stamped(k) for k in range(i + 1)]))},
    'simulated_clock': {'/pose': (bags.POSE, lambda i: stamped(i, start=0))},
    'unset_stamps': {'/pose': (bags.POSE, lambda i: message(bags.POSE, pose=pose_message(
        i), header=message('std_msgs/msg/Header', frame_id='base', stamp=message(
            'builtin_interfaces/msg/Time', sec=0, nanosec=0))))},
    'pose_beside_a_path': {'/pose': (bags.POSE, stamped), '/plan': (bags.PATH, lambda i: message(
        bags.PATH, header=header(i), poses=[]))},
}


def check_trimmed(found):
    """The motion is that of the truth, but for rest at its ends."""
    assert SECONDS - 0.5 < found.duration <= SECONDS
    np.testing.assert_allclose(found.points[[0, -1], :3], T.position[[0, -1]], atol=2e-3)
    first = int(np.argmin(np.linalg.norm(T.position - found.points[0, :3], axis=1)))
    rows = first + np.arange(len(found.times))
    np.testing.assert_allclose(found.points[:, :3], T.position[rows], atol=1e-9)
    np.testing.assert_allclose(np.abs((found.points[:, 3:7] * T.wxyz[rows]).sum(axis=1)), 1.0,
                               atol=1e-9)


@pytest.mark.parametrize('name', BAGS)
def test_bags_with_other_messages_are_read(name, tmp_path):
    check_trimmed(recordings.read(written(tmp_path / 'bag', BAGS[name])).demonstration)


def test_transforms_are_read_between_two_frames(tmp_path):
    bag = written(tmp_path / 'bag', {
        '/tf': (bags.TRANSFORMS, lambda i: message(bags.TRANSFORMS, transforms=[
            transform(i, 'link', 'base'), transform(i, 'other', 'base', False)])),
        '/tf_static': (bags.TRANSFORMS, lambda i: message(bags.TRANSFORMS, transforms=[
            transform(0, 'tool0', 'link', False)]))})
    found = recordings.read(bag, settings=Import(tf_frames=('tool0', 'base')))
    check_trimmed(found.demonstration)
    assert found.frame == 'base'
    with pytest.raises(DataError, match='--tf-frame TOOL BASE with two of base, link, other'):
        recordings.read(bag)
    with pytest.raises(DataError, match='no transforms lead from hand to base; the frames are'):
        recordings.read(bag, settings=Import(tf_frames=('hand', 'base')))


def test_an_arm_and_its_gripper_may_share_a_topic(tmp_path):
    bag = written(tmp_path / 'bag', {'/joint_states': (bags.JOINTS, lambda i: [
        joint_state(i, ['finger'], [0.04]), joint_state(i, ['a', 'b'], T.rpy[i, 1:])])})
    with pytest.raises(DataError, match='--joints'):
        recordings.read(bag)
    found = recordings.read_joints(bag)
    assert found.joints == ('a', 'b')
    np.testing.assert_allclose(found.demonstration.points[-1], T.rpy[-1, 1:], atol=2e-3)


def test_two_frames_in_one_topic_are_refused(tmp_path):
    bag = written(tmp_path / 'bag', {'/pose': (bags.POSE, lambda i: stamped(
        i, frame='base' if i % 2 else 'camera'))})
    with pytest.raises(DataError, match="the frames are 'base', 'camera', expected one"):
        recordings.read(bag)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_storage_files_and_folders_with_other_names_are_read(storage, tmp_path, recwarn):
    bag = written(tmp_path / 'take.bag', {'/pose': (bags.POSE, stamped)}, storage)
    check_trimmed(recordings.read(bag).demonstration)
    data = next(path for path in bag.iterdir() if path.suffix in bags.STORAGE_SUFFIXES)
    check_trimmed(recordings.read(data).demonstration)
    (bag / 'metadata.yaml').unlink()
    check_trimmed(recordings.read(bag).demonstration)
    assert any('there is no metadata.yaml' in str(item.message) for item in recwarn)


def test_what_a_killed_recorder_has_left_is_read(tmp_path, recwarn):
    bag = written(tmp_path / 'bag', {'/pose': (bags.POSE, stamped)})
    data, cut = next(bag.glob('*.mcap')), tmp_path / 'cut.mcap'
    cut.write_bytes(data.read_bytes()[:-200])
    check_trimmed(recordings.read(cut).demonstration)
    assert any('the recorder was killed' in str(item.message) for item in recwarn)


def test_a_bag_of_ros_1_is_read(tmp_path):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(tmp_path / 'old.bag') as writer:
        connection = writer.add_connection('/pose', bags.POSE, typestore=store)
        for i in range(len(T.times)):
            same = stamped(i)
            same.header = store.types['std_msgs/msg/Header'](
                seq=i, stamp=same.header.stamp, frame_id='base')
            writer.write(connection, START + round(1e9 * T.times[i]),
                         store.serialize_ros1(same, bags.POSE))
    check_trimmed(recordings.read(tmp_path / 'old.bag').demonstration)


def test_conversion_keeps_every_sample(tmp_path):
    bag = written(tmp_path / 'bag', {'/pose': (bags.POSE, stamped)})
    for target in ('a.csv', 'a.npz', 'a.tum', 'again'):
        assert main(['convert', str(bag), '-o', str(tmp_path / target)]) == 0
    check(episodes.read(tmp_path / 'a.csv').demonstration, 1e-9)
    check(episodes.read(tmp_path / 'a.npz').demonstration, 1e-9)
    check(episodes.read(tmp_path / 'a.tum').demonstration, 1e-9)
    check(recordings.read(tmp_path / 'again', keep_rest=True).demonstration, 1e-9)
    assert main(['convert', str(bag), '-o', str(tmp_path / 'a.xyz')]) == 1
    assert not (tmp_path / 'a.xyz').exists()


def test_a_channel_with_json_beside_does_not_matter(tmp_path):
    """A recorder of another program may write it into the same MCAP."""
    bag = written(tmp_path / 'bag', {'/pose': (bags.POSE, stamped)})
    data = next(bag.glob('*.mcap')).read_bytes()

    def record(kind, *parts):
        content = b''.join(parts)
        return bytes([kind]) + len(content).to_bytes(8, 'little') + content

    def string(value):
        return len(value).to_bytes(4, 'little') + value

    def number(value, size=2):
        return value.to_bytes(size, 'little')
    at = 8
    while data[at] != 0x0F:  # end of the data
        at += 9 + int.from_bytes(data[at + 1:at + 9], 'little')
    (tmp_path / 'mixed.mcap').write_bytes(
        data[:at] + record(0x03, number(77), string(b'note'), string(b'jsonschema'), string(b'{}'))
        + record(0x04, number(77), number(77), string(b'/note'), string(b'json'), number(0, 4))
        + record(0x05, number(77), number(0, 4), number(START, 8), number(START, 8), b'{}'))
    check_trimmed(recordings.read(tmp_path / 'mixed.mcap').demonstration)


def test_what_a_roll_out_writes_is_read(tmp_path):
    (tmp_path / 'a.csv').write_text(text(NAMES, ROWS))
    for words in (['learn', 'a.csv', '-o', 'a.json'], ['rollout', 'a.json', '-o', 'b.csv'],
                  ['learn', 'b.csv', '-o', 'b.json']):
        assert main([str(tmp_path / word) if '.' in word else word for word in words]) == 0
    first, again = (Skill.load(tmp_path / name) for name in ('a.json', 'b.json'))
    np.testing.assert_allclose(again.goal, first.goal, atol=2e-3)

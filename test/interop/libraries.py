"""
Writes files with the real libraries, and reads ours with them.

    python libraries.py PART write|read FOLDER

Runs in an environment of its own (`test.interop.run`): nothing of the project is imported.
"""
import json
import math
from pathlib import Path
import sys

import numpy as np

RATE_HZ, SECONDS, EPOCH = 50, 2.0, 1_700_000_000.0


class Truth:
    """A reach with a turn of the tool about the vertical, in metres and seconds."""

    times = np.arange(round(SECONDS * RATE_HZ) + 1) / RATE_HZ
    _s = times / SECONDS
    # It begins fast enough that nothing of it counts as rest.
    _rise = _s ** 2 * (3.0 - 2.0 * _s)
    position = np.array([0.42, -0.21, 0.35]) + np.outer(_rise, [0.11, 0.35, -0.13])
    _angle = math.pi - 0.9 * _rise
    xyzw = np.column_stack([np.sin(_angle / 2.0), 0.0 * _s, 0.0 * _s, np.cos(_angle / 2.0)])
    joints = np.outer(_rise, [0.3, -0.5, 0.2, 0.9, -0.4, 0.6, 0.1])
    #: Of a low-cost arm: degrees, and percent of the gripper.
    motors = np.array([12.0, -80.0, 70.0, 5.0, 3.0, 60.0]) + np.outer(
        _rise, [60.0, -35.0, 50.0, 20.0, -90.0, -55.0])


T = Truth


def write_tables(folder):
    """Pandas, pyarrow and evo."""
    import evo.core.trajectory as trajectory
    from evo.tools import file_interface, pandas_bridge
    import pandas
    import pyarrow
    from pyarrow import csv, parquet
    columns = {'x': T.position[:, 0], 'y': T.position[:, 1], 'z': T.position[:, 2],
               **{f'q{axis}': T.xyzw[:, k] for k, axis in enumerate('xyzw')}}
    stamped = {'time': T.times, **columns}
    frame = pandas.DataFrame(stamped)
    frame.to_csv(folder / 'pandas_index.csv')
    frame.to_csv(folder / 'pandas.csv', index=False)
    frame.to_csv(folder / 'pandas_german.csv', index=False, sep=';', decimal=',')
    frame.to_csv(folder / 'pandas.csv.gz', index=False)
    frame.to_parquet(folder / 'pandas.parquet')
    dated = pandas.DataFrame(columns, index=pandas.to_datetime(EPOCH + T.times, unit='s'))
    dated.to_csv(folder / 'pandas_dates.csv')
    dated.to_parquet(folder / 'pandas_dates.parquet')
    csv.write_csv(pyarrow.table(stamped), folder / 'pyarrow.csv')
    parquet.write_table(pyarrow.table({
        'timestamp': T.times, 'position': T.position.tolist(),
        'orientation_xyzw': T.xyzw.astype(np.float32).tolist()}), folder / 'lists.parquet')
    path = trajectory.PoseTrajectory3D(T.position, np.roll(T.xyzw, 1, axis=1), EPOCH + T.times)
    file_interface.write_tum_trajectory_file(folder / 'evo.tum', path)
    pandas_bridge.trajectory_to_df(path).to_csv(folder / 'evo_pandas.csv')


def read_tables(folder):
    """Evo and pandas."""
    from evo.tools import file_interface
    import pandas
    path = file_interface.read_tum_trajectory_file(folder / 'ours.tum')
    frame = pandas.read_csv(folder / 'ours.csv')
    return {'evo': [path.positions_xyz[[0, -1]].tolist(), len(path.timestamps)],
            'pandas': [frame[['x', 'y', 'z']].to_numpy()[[0, -1]].tolist(), len(frame)]}


POSE = """std_msgs/Header header
geometry_msgs/Pose pose
===
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
===
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
===
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
===
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
===
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
""".replace('===', '=' * 80)


def write_bags(folder):
    """mcap-ros2-support, and rosbags in three formats."""
    from mcap_ros2.writer import Writer
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import get_typestore, Stores
    stamps = [round((EPOCH + time) * 1e9) for time in T.times]
    with (folder / 'mcap_ros2.mcap').open('wb') as file, Writer(file) as writer:
        schema = writer.register_msgdef('geometry_msgs/msg/PoseStamped', POSE)
        for stamp, position, turn in zip(stamps, T.position.tolist(), T.xyzw.tolist()):
            writer.write_message('/pose', schema, {
                'header': {'stamp': {'sec': stamp // 10 ** 9, 'nanosec': stamp % 10 ** 9},
                           'frame_id': 'base'},
                'pose': {'position': dict(zip('xyz', position)),
                         'orientation': dict(zip('xyzw', turn))}}, stamp, stamp)
    for store, make in (
            (Stores.ROS2_JAZZY, lambda: rosbag2.Writer(
                folder / 'sqlite', version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3)),
            (Stores.ROS2_JAZZY, lambda: rosbag2.Writer(
                folder / 'mcap', version=9, storage_plugin=rosbag2.StoragePlugin.MCAP)),
            (Stores.ROS1_NOETIC, lambda: rosbag1.Writer(folder / 'noetic.bag'))):
        types, first = get_typestore(store), store is Stores.ROS1_NOETIC
        kinds = types.types
        header = {'seq': 0} if first else {}
        with make() as writer:
            topic = writer.add_connection('/pose', 'geometry_msgs/msg/PoseStamped',
                                          typestore=types)
            for stamp, position, turn in zip(stamps, T.position.tolist(), T.xyzw.tolist()):
                message = kinds['geometry_msgs/msg/PoseStamped'](
                    kinds['std_msgs/msg/Header'](
                        stamp=kinds['builtin_interfaces/msg/Time'](
                            sec=stamp // 10 ** 9, nanosec=stamp % 10 ** 9),
                        frame_id='base', **header),
                    kinds['geometry_msgs/msg/Pose'](
                        kinds['geometry_msgs/msg/Point'](*position),
                        kinds['geometry_msgs/msg/Quaternion'](*turn)))
                writer.write(topic, stamp, types.serialize_ros1(message, topic.msgtype) if first
                             else types.serialize_cdr(message, topic.msgtype))


def read_bags(folder):
    """mcap-ros2-support."""
    from mcap_ros2.reader import read_ros2_messages
    path = next((folder / 'ours_mcap').glob('*.mcap'))
    poses = [message.ros_msg.pose.position for message in read_ros2_messages(path)
             if message.channel.topic.endswith('pose')]
    return {'mcap_ros2': [[[p.x, p.y, p.z] for p in (poses[0], poses[-1])], len(poses)]}


def _data_set():
    try:
        from lerobot.datasets.lerobot_dataset import LeRobotDataset
    except ImportError:
        from lerobot.common.datasets.lerobot_dataset import LeRobotDataset
    return LeRobotDataset


def write_lerobot(folder):
    """LeRobot, as joints of an arm and as poses of its tool."""
    import inspect
    kind = _data_set()
    joints = [f'joint_{k}.pos' for k in range(1, 8)]
    motors = [f'{name}.pos' for name in ('shoulder_pan', 'shoulder_lift', 'elbow_flex',
                                         'wrist_flex', 'wrist_roll', 'gripper')]
    pose = ['ee.x', 'ee.y', 'ee.z', 'ee.qx', 'ee.qy', 'ee.qz', 'ee.qw']
    for name, names, rows in (('lerobot_joints', joints, T.joints),
                              ('lerobot_motors', motors, T.motors),
                              ('lerobot_poses', pose, np.hstack([T.position, T.xyzw]))):
        feature = {'dtype': 'float32', 'shape': (len(names),), 'names': names}
        made = kind.create('me/reach', RATE_HZ, root=folder / name, robot_type='panda',
                           features={'observation.state': feature, 'action': feature},
                           use_videos=False)
        separate = 'task' in inspect.signature(made.add_frame).parameters
        for row in rows.astype(np.float32):
            frame = {'observation.state': row, 'action': row}
            if separate:
                made.add_frame(frame, task='reach')
            else:
                made.add_frame({**frame, 'task': 'reach'})
        made.save_episode()
        if hasattr(made, 'finalize'):
            made.finalize()


def read_lerobot(folder):
    """Read our data set."""
    data = _data_set()('me/ours', root=folder / 'ours_lerobot')
    rows = [np.asarray(data[k]['observation.state'])[:3].tolist() for k in (0, len(data) - 1)]
    return {'lerobot': [rows, len(data)]}


class Robot:
    """A robot without motors: it remembers what `lerobot-replay` sends."""

    name, robot_type, is_connected = 'so101_follower', 'so101_follower', True

    def __init__(self):
        self.sent = []

    def connect(self, *_, **__):
        pass

    def disconnect(self):
        pass

    def get_observation(self):
        return {}

    def send_action(self, action):
        self.sent.append({name: float(value) for name, value in action.items()})
        return action


def read_replay(folder):
    """Replay our episode with LeRobot's own program, on a robot without motors."""
    from lerobot.scripts import lerobot_replay as program
    robot = Robot()
    program.make_robot_from_config = lambda config: robot
    program.replay(program.ReplayConfig(
        robot=program.RobotConfig(), play_sounds=False,
        dataset=program.DatasetReplayConfig(
            repo_id='me/motors', episode=0, root=folder / 'ours_motors', fps=RATE_HZ)))
    return {'sent': robot.sent}


def read_robomimic(folder):
    """Read our data set with the loader that trains."""
    from robomimic.utils.dataset import SequenceDataset
    import robomimic.utils.obs_utils as observations
    keys = ['robot0_eef_pos', 'robot0_eef_quat']
    observations.initialize_obs_utils_with_obs_specs({'obs': {'low_dim': keys, 'rgb': []}})
    data = SequenceDataset(str(folder / 'ours.hdf5'), obs_keys=keys, dataset_keys=['actions'],
                           hdf5_cache_mode='all', seq_length=1, load_next_obs=False)
    rows = [np.asarray(data[k]['obs']['robot0_eef_pos'])[0].tolist() for k in (0, len(data) - 1)]
    return {'robomimic': [rows, len(data)]}


if __name__ == '__main__':
    part, what, place = sys.argv[1:]
    result = globals()[f'{what}_{part}'](Path(place))
    if result is not None:
        print('RESULT', json.dumps(result))

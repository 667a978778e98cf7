"""Convert demonstrations and skills from and to other formats.

Demonstrations: rosbag2 folders, tables (.csv), NumPy archives (.npz), MATLAB (.mat), HDF5 (.h5,
.hdf5; also robomimic), Parquet, LeRobot data sets (versions 2 and 3; version 3 is written).
Skills: ours, and CartesianDMP in movement_primitives' JSON. From a skill its motion is written;
with --rollouts N, N random motions from the distribution of its takes. A skill of joints that was
learned from a LeRobot data set is written with its names and units, for lerobot-replay: --start
says where the robot is, because replay sends the first action at once.

What the arrays and columns of other programs mean is told by their names (position, tx, x_mm,
roll [deg], tcp_quat_xyzw, ...) and printed. What no name tells is decided from the numbers; where
two readings fit, the error names the option to give: --key, --quaternion, --rotation, --scale,
--time-unit or --rate-hz. Of a file with several episodes data.hdf5#2 is the third one. --rate-hz
is also the rate of a skill's motion (default 100).

The name of the result determines its format: .csv, .npz, .tum (poses only, as evo reads them),
.hdf5 (robomimic), .json (a skill), without a suffix or with .bag a rosbag2 folder; --as overrides
it. Several demonstrations become several bags.

examples:
  gdmp convert takes/take_001 -o take.csv
  gdmp convert optitrack.csv -o take --quaternion xyzw --scale 0.001
  gdmp convert data.mat -o take --key points=traj --rate-hz 100
  gdmp convert takes -o dataset --as lerobot --fps 30 --task "write a G"
  gdmp convert skill.json -o rollouts.hdf5 --rollouts 50 --fps 20
  gdmp convert skill.json -o motion.npz --rate-hz 200
  gdmp convert joints.json -o episode --as lerobot --start -3.1 20.4 5 -12 0 31.5
  gdmp convert skill.json -o cartesian_dmp.json --as movement_primitives
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from gdmp_ros.cli.arguments import (
    add_bag_output,
    add_import,
    add_output,
    add_overwrite,
    add_pose_topic,
    check_free,
    import_settings,
    integer,
)
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

if TYPE_CHECKING:
    import numpy as np

    from gdmp_ros.data.lerobot import Joints
    from gdmp_ros.dmp.demonstration import Demonstration
    from gdmp_ros.dmp.skill import Skill

FORMATS = ('csv', 'npz', 'tum', 'bag', 'skill', 'movement_primitives', 'lerobot', 'robomimic')
_BY_SUFFIX = {'.csv': 'csv', '.npz': 'npz', '.tum': 'tum', '.json': 'skill', '.h5': 'robomimic',
              '.hdf5': 'robomimic', '': 'bag', '.bag': 'bag'}
T = TypeVar('T')
#: Samples per second of a skill's motion, and of a data set; type of the robot of a data set.
RATE_HZ, FPS, ROBOT = 100.0, 30, 'panda'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('sources', type=Path, nargs='+', metavar='FROM')
    add_output(parser, 'TO', 'what is written')
    parser.add_argument('--as', dest='format', choices=FORMATS, help='format of the result')
    add_pose_topic(parser)
    add_import(parser)
    parser.add_argument('--fps', type=integer(1, 1000), metavar='N',
                        help='frames per second of LeRobot and robomimic data sets (default: '
                             f'those of the data set that a skill was learned from, else {FPS})')
    parser.add_argument('--start', type=float, nargs='+', metavar='NUMBER',
                        help='where the motion of a skill begins, in the numbers of the result: '
                             'the present joints of a robot that replays it')
    parser.add_argument('--task', default='a demonstrated motion', metavar='TEXT',
                        help='what is done, in words, for LeRobot')
    parser.add_argument('--rollouts', type=integer(1, 100_000), default=1, metavar='N',
                        help='motions of a skill of several takes that vary as the takes did')
    add_bag_output(parser)
    add_overwrite(parser)


def run(options: argparse.Namespace) -> None:
    """Convert; nothing is written unless the sources are valid."""
    if options.format is None and options.output.suffix not in _BY_SUFFIX:
        raise DataError(f'{options.output}: {options.output.suffix} files are not written; use a '
                        f'name that ends in {", ".join(filter(None, _BY_SUFFIX))}, a folder for '
                        'a bag, or --as')
    import_settings(options)
    check_free([options.output], options.overwrite)
    try:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        with optional_import(extra('bench')):
            _convert(options, options.format or _BY_SUFFIX[options.output.suffix])
    except OSError as error:
        raise DataError(f'{options.output}: cannot write: {error.strerror}') from None
    print(f'wrote {options.output}')


def _convert(options: argparse.Namespace, target: str) -> None:
    from gdmp_ros.data import foreign, lerobot, robomimic
    from gdmp_ros.dmp.skill import Skill
    output = options.output
    if target == 'movement_primitives':
        deviation = foreign.to_movement_primitives(output, _skill(_only(options.sources)))
        print(f'the pose only; its motion deviates by at most {1e3 * deviation:.1f} mm')
        return
    if options.start is not None and any(source.suffix != '.json' for source in options.sources):
        raise DataError('--start is for skills (.json): demonstrations begin where they were '
                        'shown')
    result = [demo for source in options.sources for demo in _demonstrations(options, source)]
    demos = [demonstration for demonstration, _ in result]
    if target in ('lerobot', 'robomimic') and demos and demos[0].manifold.point_size > 7:
        print(f'state and action have the pose and the stiffness: {demos[0].manifold.point_size} '
              'numbers')
    if target == 'skill':
        names = [str(source) for source in options.sources]
        Skill.learn(demos, provenance={'converted from': names}).save(output)
    elif target == 'bag':
        _write_bags(options, result)
    elif target == 'lerobot':
        if output.exists():
            raise DataError(f'{output}: exists; a data set is not replaced')
        robot, joints, shown_fps = _recorded_as(options.sources)
        lerobot.write(output, demos, options.fps or shown_fps, options.task, robot, joints)
    elif target == 'robomimic':
        robomimic.write(output, demos, options.fps or FPS)
    else:
        {'csv': foreign.write_csv, 'npz': foreign.write_npz, 'tum': foreign.write_tum}[target](
            output, _only(demos))


def _only(result: list[T]) -> T:
    """:raises DataError: unless there is exactly one"""
    if len(result) != 1:
        raise DataError(f'there are {len(result)} demonstrations, but the result holds one: name '
                        'an episode, such as data.hdf5#0, or convert to bags, LeRobot or HDF5')
    return result[0]


def _write_bags(options: argparse.Namespace, result: list[tuple[Demonstration, str]]) -> None:
    from gdmp_ros.data import recordings
    output = options.output
    for number, (demo, frame) in enumerate(result, 1):
        bag = output if len(result) == 1 else output / f'take_{number:03d}'
        bag.parent.mkdir(parents=True, exist_ok=True)
        recordings.overwrite(bag, demo, frame, recordings.EPOCH_NS, options.storage)


def _skill(source: Path) -> Skill:
    from gdmp_ros.dmp.skill import Skill
    if source.suffix != '.json':
        raise DataError(f'{source}: only a skill (.json) becomes a movement primitive; learn one '
                        'with gdmp learn')
    return Skill.load(source)


def _demonstrations(options: argparse.Namespace, source: Path) -> list[tuple[Demonstration, str]]:
    """The demonstrations in a source, and their frames."""
    from gdmp_ros.data import bags, episodes, foreign, recordings, tables, takes
    if episodes.is_foreign(source):
        return [(_imported(item, options), options.frame) for item in episodes.sources(source)]
    if not source.exists():
        raise DataError(f'{source}: no such bag or file')
    if source.is_dir() or source.suffix in bags.FILES:
        read = [recordings.read(bag, options.pose_topic, settings=import_settings(options),
                                keep_rest=True) for bag in takes.bags_in(source)]
        return [(item.demonstration, item.frame) for item in read]
    if source.suffix != '.json':
        raise DataError(f'{source}: format not read; use a bag, a skill (.json) or a file that '
                        f'ends in {", ".join(tables.SUFFIXES)}')
    if foreign.is_foreign(source):
        return [(foreign.from_movement_primitives(source), options.frame)]
    return _motions(options, source)


def _imported(source: Path, options: argparse.Namespace) -> Demonstration:
    from gdmp_ros.data import episodes
    result = episodes.read(source, import_settings(options))
    if result.notes:
        print(f'{source}: {"; ".join(result.notes)}')
    return result.demonstration


def _motions(options: argparse.Namespace, source: Path) -> list[tuple[Demonstration, str]]:
    """The motion of a skill, or several that vary as its takes did."""
    import numpy as np

    from gdmp_ros.data import foreign
    from gdmp_ros.dmp.skill import Skill
    skill, step = Skill.load(source), 1.0 / (options.rate_hz or RATE_HZ)
    frame = skill.provenance.get('frame', options.frame)
    start = None if options.start is None else _start_of(skill, options.start, source)
    if options.rollouts == 1:
        return [(foreign.motion(skill, step, start), frame)]
    around, rng = skill.distribution, np.random.default_rng(0)
    if around is None:
        raise DataError(f'{source}: a skill of a single take does not know how takes vary: '
                        '--rollouts needs one of several')
    return [(foreign.motion(around.sample(rng), step, start), frame)
            for _ in range(options.rollouts)]


def _start_of(skill: Skill, given: list[float], source: Path) -> np.ndarray:
    import numpy as np
    if len(given) != skill.manifold.point_size:
        raise DataError(f'{source}: --start has {len(given)} numbers, expected '
                        f'{skill.manifold.point_size}')
    flat = np.array(given) * float(skill.provenance.get('joint_unit', 1.0))
    return skill.manifold.check_point(flat.reshape(skill.manifold.point_shape))


def _recorded_as(sources: list[Path]) -> tuple[str, Joints | None, int]:
    """Type of the robot, joints, and frames per second of what a skill was learned from."""
    from gdmp_ros.data import foreign
    from gdmp_ros.data.lerobot import Joints
    from gdmp_ros.dmp.skill import Skill
    source = sources[0]
    said = {} if source.suffix != '.json' or foreign.is_foreign(source) else Skill.load(
        source).provenance
    joints = (Joints(said['joints'], float(said.get('joint_unit', 1.0)))
              if said.get('joints') else None)
    return said.get('robot_type', ROBOT), joints, said.get('fps', FPS)

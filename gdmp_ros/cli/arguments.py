"""Arguments that several verbs have."""
from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from gdmp_ros.choices import ARMS, ROLES, ROTATIONS, SCALES, STORAGES
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.optional_imports import extra, optional_import

if TYPE_CHECKING:
    from gdmp_ros.data.arm_joints import ArmJoints
    from gdmp_ros.data.columns import Import
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.ros.arm_choice import ArmChoice

T = TypeVar('T', int, float)


def add_output(parser: argparse.ArgumentParser, metavar: str, text: str, *,
               required: bool = True) -> None:
    """Declare ``-o``; of a file, unless the name for the help is ``DIR`` or ``TO``."""
    parser.add_argument('-o', '--out', '--output', required=required, dest='output',
                        type=Path if metavar in ('DIR', 'TO') else _file_name, metavar=metavar,
                        help=text)


def _file_name(text: str) -> Path:
    """:raises ArgumentTypeError: for a name with a slash at its end"""
    if text.endswith('/'):
        raise argparse.ArgumentTypeError(f'{text} is the name of a folder, expected that of a '
                                         'file')
    return Path(text)


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Declare ``--overwrite``; see `check_free`."""
    parser.add_argument('--overwrite', action='store_true', help='replace what exists')


def check_free(targets: Iterable[Path], overwrite: bool) -> None:
    """:raises DataError: if something exists that must not be replaced"""
    for target in targets:
        if target.exists() and not overwrite:
            raise DataError(f'{target}: exists already; --overwrite replaces it')


def add_bags(parser: argparse.ArgumentParser) -> None:
    """Declare ``bags`` and the topic of their poses; see `gdmp_ros.data.takes.bags_in`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='rosbag2 folders, or folders of them')
    add_pose_topic(parser)


def add_pose_topic(parser: argparse.ArgumentParser) -> None:
    """Declare ``--pose-topic``."""
    parser.add_argument('--pose-topic', default='', metavar='TOPIC',
                        help='topic of the poses, if a bag has several')


def add_import(parser: argparse.ArgumentParser, has_model: bool = False) -> None:
    """
    Declare what is said about files of other programs; see `import_settings`.

    :param has_model: whether ``--model`` means something else
    """
    parser.add_argument('--key', action='append', default=[], metavar='ROLE=NAME',
                        help='name of an array, or of columns with commas between them (w first); '
                             f'roles: {", ".join(ROLES)}')
    parser.add_argument('--quaternion', choices=('wxyz', 'xyzw'), default='',
                        help='order of the numbers of quaternions in the source')
    parser.add_argument('--rotation', choices=ROTATIONS, default='',
                        help='what three numbers of a rotation are: a rotation vector, or angles '
                             'about fixed axes (xyz is roll, pitch, yaw) or moving ones (XYZ)')
    parser.add_argument('--scale', type=number(above=0.0), metavar='X',
                        help='factor of the positions, 0.001 for millimetres')
    parser.add_argument('--offset', type=float, nargs=3, default=(0.0, 0.0, 0.0),
                        metavar=('X', 'Y', 'Z'), help='added to the scaled positions [m]')
    parser.add_argument('--rate-hz', type=number(1e-2, 100_000.0), metavar='HZ',
                        help='samples per second of the source; its times are not used then')
    parser.add_argument('--time-unit', choices=('s', 'ms', 'us', 'ns'), default='',
                        help='unit of the times of the source')
    parser.add_argument('--angle-unit', '--units', choices=('rad', 'deg', 'percent'), default='',
                        help='unit of angles in the source; percent: of the range of the motors, '
                             'as LeRobot writes it')
    parser.add_argument('--urdf', type=Path, metavar='FILE',
                        help='read recordings of joints as motions of the tool of this robot')
    parser.add_argument('--tip', default='', metavar='LINK',
                        help='link of the URDF that is the tool')
    parser.add_argument('--base', default='', metavar='LINK',
                        help='link of the URDF that the poses are in (default: the first one)')
    parser.add_argument('--joints-of', *([] if has_model else ['--model']), default='',
                        metavar='MODEL', dest='joints_of',
                        help='as --urdf, of a model: panda, fr3, ur5e, xarm7, an MJCF file, '
                             'menagerie:NAME')
    parser.add_argument('--calibration', type=Path, metavar='JSON',
                        help='of the motors of a LeRobot arm, for --units percent')
    parser.add_argument('--tf-frame', nargs=2, metavar=('TOOL', 'BASE'),
                        help='frames of a bag with transforms: the poses of TOOL in BASE')
    parser.add_argument('--drop-bad', action='store_true',
                        help='leave out samples with missing numbers, or whose times do not '
                             'increase; how many is told')


def import_settings(options: argparse.Namespace) -> Import:
    """
    What the arguments of `add_import` say.

    :raises ParameterError: if something is out of range
    """
    from gdmp_ros.data.columns import Import
    keys = {}
    for pair in options.key:
        role, _, name = pair.partition('=')
        if role not in ROLES or not name:
            raise ParameterError(f'--key {pair}: expected ROLE=NAME with a role of '
                                 f'{", ".join(ROLES)}')
        keys[role] = name
    return Import(keys, options.quaternion, options.rate_hz, options.scale, tuple(options.offset),
                  options.rotation, options.time_unit, options.angle_unit, options.drop_bad,
                  options.tf_frame and tuple(options.tf_frame), joints=_arm_joints(options))


def _arm_joints(options: argparse.Namespace) -> ArmJoints | None:
    """
    The arm whose joints are read as motions of its tool; None without one.

    :raises ParameterError: if half of it is said
    """
    model = getattr(options, 'model', '')  # of verbs that also draw the arm
    if options.urdf is None and not options.joints_of and not model:
        for name in ('tip', 'base', 'calibration'):
            if getattr(options, name):
                raise ParameterError(f'--{name} is for --urdf or --joints-of')
        return None
    if options.urdf is not None and (options.joints_of or not options.tip):
        raise ParameterError('--urdf needs --tip LINK, the tool' if not options.joints_of else
                             '--urdf and --joints-of: give one of them')
    from gdmp_ros.data.arm_joints import ArmJoints
    with optional_import(extra('sim')):
        from gdmp_ros.sim.tip import from_model, from_urdf
    if options.urdf is not None:
        arm = from_urdf(options.urdf, options.tip, options.base)
    else:
        arm = from_model(options.joints_of or model, options.tip, options.base)
    return ArmJoints(arm, options.calibration, not (options.urdf or options.joints_of))


def add_arm_node(parser: argparse.ArgumentParser) -> None:
    """Declare ``--node`` of a verb that works with a running arm."""
    parser.add_argument('--node', default='panda_sim',
                        help='node of the arm, with its namespace (default %(default)s)')


def add_bag_output(parser: argparse.ArgumentParser) -> None:
    """Declare how bags are written."""
    parser.add_argument('--storage', choices=STORAGES, default='mcap',
                        help='storage format of the bags (default %(default)s)')
    parser.add_argument('--frame', default='panda_link0',
                        help='frame_id of the poses (default %(default)s)')


def add_stiffness_range(parser: argparse.ArgumentParser) -> None:
    """Declare the range of a stiffness that is computed from the variance of takes."""
    parser.add_argument('--k-min', type=number(above=0.0), default=200.0, metavar='N/M',
                        help='smallest stiffness from variance [N/m] (default %(default)g)')
    parser.add_argument('--k-max', type=number(above=0.0), default=800.0, metavar='N/M',
                        help='largest stiffness from variance [N/m] (default %(default)g)')


def add_context(parser: argparse.ArgumentParser) -> None:
    """Declare ``--context``, a dictionary."""
    parser.add_argument('--context', nargs='+', action=_NamedNumbers, default={},
                        metavar='NAME=NUMBER',
                        help='use the skill in this context, of a skill that was learned with '
                             'contexts')


def add_objects(parser: argparse.ArgumentParser) -> None:
    """Declare ``--object``, a list of names with the numbers of a pose."""
    parser.add_argument('--object', nargs=8, action='append', default=[], dest='objects',
                        metavar=('NAME', 'X', 'Y', 'Z', 'QW', 'QX', 'QY', 'QZ'),
                        help='where an object is, of a skill with task frames [m]; may be '
                             'repeated (default: where it was shown)')


def add_scale(parser: argparse.ArgumentParser) -> None:
    """Declare ``--object-scale``, what happens to the size of a motion between objects."""
    parser.add_argument('--object-scale', choices=SCALES, default='none',
                        help='of a skill with task frames: its shape keeps its size (default), or '
                             'shrinks and grows with the distance from start to goal')


def poses_of_objects(given: Sequence[Sequence[str]]) -> dict[str, list[float]]:
    """
    The poses of ``--object``, by name.

    :raises ParameterError: if they are no numbers
    """
    poses = {}
    for name, *words in given:
        try:
            poses[name] = [float(word) for word in words]
        except ValueError:
            raise ParameterError(f'--object {name}: {" ".join(words)!r} are not 7 numbers'
                                 ) from None
    return poses


def among_objects(skill: Skill, given: Sequence[Sequence[str]], scale: str = 'none') -> Skill:
    """
    The skill with the objects of ``--object``.

    :raises ParameterError: if it has no such frames, or they are no poses
    """
    if not given and scale == 'none':
        return skill
    return skill.with_frames(poses_of_objects(given), scale)


class _NamedNumbers(argparse.Action):
    """Collects ``name=number`` in a dictionary."""

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace,
                 values: object, option_string: str | None = None) -> None:
        result = {}
        for word in values if isinstance(values, list) else []:
            name, _, number = str(word).partition('=')
            try:
                result[name] = float(number)
            except ValueError:
                parser.error(f'{option_string}: {word!r} is not NAME=NUMBER')
        setattr(namespace, self.dest, result)


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Declare ``--namespace``."""
    parser.add_argument('--namespace', default='', metavar='NAME',
                        help='namespace of the robot, if a bag has several')


def add_parallel(parser: argparse.ArgumentParser) -> None:
    """Declare where many tasks are done."""
    parser.add_argument('--jobs', type=integer(-1), default=1, metavar='N',
                        help='processes; -1: one per core (default %(default)s)')
    parser.add_argument('--backend', nargs=2, default=(), metavar=('dask', 'ADDRESS'),
                        help='work on a Dask cluster instead')
    parser.add_argument('--resume', type=Path, metavar='FILE',
                        help='keep finished parts in this file and continue from it')


def add_arm(parser: argparse.ArgumentParser) -> None:
    """Declare which arm is started; see `arm_choice`."""
    parser.add_argument('--arm', choices=ARMS, default='sim',
                        help='sim: simulated Panda; franka: a Franka Research 3; ur5e: a '
                             'simulated UR5e that takes joint positions, with a sensor at its '
                             'wrist (default %(default)s)')
    add_franka(parser)
    add_parameter_files(parser)


def add_parameter_files(parser: argparse.ArgumentParser) -> None:
    """Declare ``--friction``."""
    parser.add_argument('--friction', '--params-file', type=Path, action='append', default=[],
                        metavar='YAML', help='parameter file of the arm that is started: its '
                        'friction, from gdmp arm friction, or limits; may be repeated, the last '
                        'one wins')


def add_franka(parser: argparse.ArgumentParser) -> None:
    """Declare where a Franka is."""
    parser.add_argument('--host', default='', help='address of the Franka')
    parser.add_argument('--protocol-server', action='store_true',
                        help='instead of a robot, start a server that speaks its protocol, with a '
                             'simulated arm behind it')


def arm_choice(options: argparse.Namespace) -> ArmChoice:
    """
    The arm that the arguments ask for.

    :raises GdmpError: if something is missing or contradicts something else
    """
    from gdmp_ros.franka.greeting import check_answers
    from gdmp_ros.ros.arm_choice import ArmChoice
    choice = ArmChoice(options.arm, options.host, options.protocol_server,
                       tuple(options.friction))
    choice.check()
    if choice.host:
        check_answers(choice.host)
    return choice


def check_output(path: Path | None, *suffixes: str) -> None:
    """
    Check the name of a file that is to be written, before any work is done.

    :param path: its folder is made later, if it does not exist; None: nothing is written
    :param suffixes: of which it must have one; any without them
    :raises DataError: if it cannot be written there
    """
    if path is None:
        return
    if path.is_dir():
        raise DataError(f'{path}: is a folder, expected the name of a file')
    if suffixes and path.suffix.lower() not in suffixes:
        raise DataError(f'{path}: expected a name that ends in {" or ".join(suffixes)}')
    folder = path.absolute().parent
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise DataError(f'{path}: {folder} is no folder')
    if not os.access(folder, os.W_OK | os.X_OK):
        raise DataError(f'{path}: {folder} cannot be written')


def number(low: float = -math.inf, high: float = math.inf,
           above: float = -math.inf) -> Callable[[str], float]:
    """
    Type of an argument that is a finite number within limits.

    :param low: smallest value
    :param high: largest value
    :param above: value that must be exceeded
    """
    return lambda text: _within(text, float, low, high, above)


def integer(low: float = -math.inf, high: float = math.inf) -> Callable[[str], int]:
    """Type of an argument that is an integer within limits; see `number`."""
    return lambda text: _within(text, int, low, high, -math.inf)


def _within(text: str, kind: type[T], low: float, high: float, above: float) -> T:
    """:raises ArgumentTypeError: if the number is not within the limits"""
    with suppress(ValueError):
        value = kind(text)
        if math.isfinite(value) and low <= value <= high and value > above:
            return value
    limits = [words for words, exists in ((f'more than {above:g}', above > -math.inf),
                                          (f'at least {low:g}', low > -math.inf),
                                          (f'at most {high:g}', high < math.inf)) if exists]
    name = 'a finite number' if kind is float else 'an integer'
    raise argparse.ArgumentTypeError(
        f'is {text}, expected {name}' + (f', {" and ".join(limits)}' if limits else ''))

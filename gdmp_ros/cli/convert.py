"""Convert demonstrations and skills from and to other formats.

Demonstrations: rosbag2 folders, CSV (time,x,y,z,qw,qx,qy,qz, k11,k12,… of a stiffness) and NumPy
archives (times, points). Skills: ours, and CartesianDMP in movement_primitives' JSON. A skill that
is converted to a demonstration becomes its motion. The name of the result determines its format:
.csv, .npz, .json (a skill), anything else a rosbag2 folder; --as overrides it.

examples:
  gdmp convert takes/take_001 -o take.csv
  gdmp convert take.csv -o takes/take_009
  gdmp convert skill.json -o motion.npz --rate-hz 200
  gdmp convert skill.json -o cartesian_dmp.json --as movement_primitives
  gdmp convert cartesian_dmp.json -o skill.json
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gdmp_ros.cli.arguments import add_bag_output, check_number
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

if TYPE_CHECKING:
    from gdmp_ros.dmp.demonstration import Demonstration
    from gdmp_ros.dmp.skill import Skill

FORMATS = ('csv', 'npz', 'bag', 'skill', 'movement_primitives')
_BY_SUFFIX = {'.csv': 'csv', '.npz': 'npz', '.json': 'skill'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', type=Path, metavar='FROM')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='TO')
    parser.add_argument('--as', dest='format', choices=FORMATS, help='format of the result')
    parser.add_argument('--rate-hz', type=float, default=100.0, metavar='HZ',
                        help='samples per second of the motion of a skill (default %(default)g)')
    add_bag_output(parser)
    parser.add_argument('--force', action='store_true', help='replace an existing file')


def run(options: argparse.Namespace) -> None:
    """Convert; nothing is written unless the source is valid."""
    check_number('--rate-hz', options.rate_hz, 1.0, 10_000.0)
    if options.output.exists() and not options.force:
        raise DataError(f'{options.output}: exists already; use --force to replace it')
    try:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        with optional_import(extra('bench')):
            _convert(options, options.format or _BY_SUFFIX.get(options.output.suffix, 'bag'))
    except OSError as error:
        raise DataError(f'{options.output}: cannot write: {error.strerror}') from None
    print(f'wrote {options.output}')


def _convert(options: argparse.Namespace, target: str) -> None:
    from gdmp_ros.data import exchange, recordings
    from gdmp_ros.dmp.skill import Skill
    source, output = options.source, options.output
    if target == 'movement_primitives':
        deviation = exchange.to_movement_primitives(output, _skill(source))
        print(f'the pose only; its motion deviates by at most {1e3 * deviation:.1f} mm')
        return
    shown, frame = _demonstration(options)
    if target == 'skill':
        Skill.learn(shown, provenance={'converted from': str(source)}).save(output)
    elif target == 'bag':
        recordings.overwrite(output, shown, frame, recordings.EPOCH_NS, options.storage)
    elif target == 'csv':
        exchange.write_csv(output, shown)
    else:
        exchange.write_npz(output, shown)


def _skill(source: Path) -> Skill:
    from gdmp_ros.dmp.skill import Skill
    if source.suffix != '.json':
        raise DataError(f'{source}: only a skill (.json) becomes a movement primitive; learn one '
                        'with gdmp learn')
    return Skill.load(source)


def _demonstration(options: argparse.Namespace) -> tuple[Demonstration, str]:
    """The source as a demonstration, and its frame."""
    from gdmp_ros.data import exchange, recordings
    from gdmp_ros.dmp.skill import Skill
    source, frame = options.source, options.frame
    if not source.exists():
        raise DataError(f'{source}: no such bag or file')
    if source.is_dir():
        recording = recordings.read(source)
        return recording.demonstration, recording.frame
    if source.suffix == '.csv':
        return exchange.read_csv(source), frame
    if source.suffix == '.npz':
        return exchange.read_npz(source), frame
    if exchange.is_foreign(source):
        return exchange.from_movement_primitives(source), frame
    skill = Skill.load(source)
    return exchange.motion(skill, 1.0 / options.rate_hz), skill.provenance.get('frame', frame)

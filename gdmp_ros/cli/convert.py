"""Convert demonstrations and skills from and to other formats.

Demonstrations: rosbag2 folders, CSV (time,x,y,z,qw,qx,qy,qz, k11,k12,… of a stiffness) and NumPy
archives (times, points). Skills: ours, and CartesianDMP in movement_primitives' JSON. A skill that
is converted to a demonstration becomes its motion. What the result is, is told by its name: .csv,
.npz, .json (a skill), anything else a rosbag2 folder; --as says otherwise.

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

from gdmp_ros.cli.record import EPOCH_NS
from gdmp_ros.data import exchange, recordings
from gdmp_ros.data.bags import STORAGES
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

HELP = 'convert demonstrations and skills from and to other formats'
KINDS = ('csv', 'npz', 'bag', 'skill', 'movement_primitives')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', type=Path, metavar='FROM')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='TO')
    parser.add_argument('--as', dest='kind', choices=KINDS, help='what the result is')
    parser.add_argument('--rate-hz', type=float, default=100.0, metavar='HZ',
                        help='samples a second of the motion of a skill (default %(default)g)')
    parser.add_argument('--storage', choices=sorted(STORAGES), default='mcap')
    parser.add_argument('--frame', default='panda_link0',
                        help='frame_id of a bag, where the source has none')
    parser.add_argument('--force', action='store_true', help='replace what exists')


def run(options: argparse.Namespace) -> None:
    """Convert; nothing is written unless the source is good."""
    if not 1.0 <= options.rate_hz <= 10_000.0:
        raise DataError(f'--rate-hz is {options.rate_hz:g}, expected 1 to 10000')
    if options.output.exists() and not options.force:
        raise DataError(f'{options.output}: exists already; use --force to replace it')
    kind = options.kind or {'.csv': 'csv', '.npz': 'npz', '.json': 'skill'}.get(
        options.output.suffix, 'bag')
    try:
        options.output.parent.mkdir(parents=True, exist_ok=True)
        with optional_import(extra('bench')):
            _convert(options, kind)
    except OSError as error:
        raise DataError(f'{options.output}: cannot write: {error.strerror}') from None
    print(f'wrote {options.output}')


def _convert(options: argparse.Namespace, kind: str) -> None:
    source, output = options.source, options.output
    if kind == 'movement_primitives':
        away = exchange.to_movement_primitives(output, _skill(source))
        print(f'the pose only; its motion is at most {1e3 * away:.1f} mm off')
        return
    if kind == 'skill':
        shown, _ = _shown(options)
        Skill.learn(shown, provenance={'converted from': str(source)}).save(output)
        return
    shown, frame = _shown(options)
    if kind == 'bag':
        recordings.replace(output, shown, frame, EPOCH_NS, options.storage)
    else:
        {'csv': exchange.write_csv, 'npz': exchange.write_npz}[kind](output, shown)


def _skill(source: Path) -> Skill:
    if source.suffix != '.json':
        raise DataError(f'{source}: only a skill (.json) becomes a movement primitive; learn one '
                        'with gdmp learn')
    return Skill.load(source)


def _shown(options: argparse.Namespace) -> tuple[Demonstration, str]:
    """The source as a demonstration, and its frame."""
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

"""Write demonstrations from a data set: rosbag2 recordings, or data on a manifold.

As recordings, the LASA human handwriting data set becomes motions of a tool in a Panda's
workspace: the letter is scaled to 25 cm and lifted onto a shallow bowl, the tool points down and
leans into the stroke, and the stiffness comes from the variance over the strokes (Gaussian mixture
regression).

With --manifold it becomes the Riemannian LASA data set instead: one NumPy archive per class with
the arrays times_1, points_1, times_2, … of every demonstration, on R2, S2, S3, SO3 or SPD2, or the
covariances of the class over time. What concerns bags and robots is then not used.

examples:
  gdmp record lasa GShape -o demos
  gdmp record lasa all --manifold S3 -o riemannian
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.data import archives, lasa, recordings
from gdmp_ros.data.bags import NS, STORAGES
from gdmp_ros.errors import DataError
from gdmp_ros.util.terminal import progress

HELP = 'write demonstrations from a data set: rosbag2, or on a manifold'
#: First stamp of the recordings, one minute apart: fixed, so that recordings are reproducible.
EPOCH_NS = 1_700_000_000 * NS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', choices=['lasa'], help='data set')
    parser.add_argument('name', metavar='CLASS', help=f'class, one of {", ".join(lasa.CLASSES)}; '
                        'with --manifold also all')
    parser.add_argument('--manifold', choices=[*lasa.MAPPINGS, lasa.COVARIANCES],
                        help='write the Riemannian data set as NumPy archives instead of bags')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='DIR',
                        help='folder for the bags CLASS_1, CLASS_2, …, or archives')
    parser.add_argument('--storage', choices=sorted(STORAGES), default='mcap')
    parser.add_argument('--frame', default='panda_link0', help='frame_id of the poses')
    parser.add_argument('--extent', type=float, default=lasa.EXTENT_M, metavar='M',
                        help='size of the letter [m] (default %(default)s)')
    parser.add_argument('--k-min', type=float, default=200.0, metavar='N/M',
                        help='smallest stiffness [N/m] (default %(default)s)')
    parser.add_argument('--k-max', type=float, default=800.0, metavar='N/M',
                        help='largest stiffness [N/m] (default %(default)s)')
    parser.add_argument('--force', action='store_true', help='replace what exists')


def run(options: argparse.Namespace) -> None:
    """Record; nothing is written unless all names are free."""
    if options.manifold:
        if options.name not in (*lasa.CLASSES, 'all'):
            lasa.strokes(options.name)  # says what is expected
        try:
            _archives(options)
        except OSError as error:
            raise DataError(f'{options.output}: cannot write: {error.strerror}') from None
        return
    if not 0.0 < options.extent <= 2.0:
        raise DataError(f'extent is {options.extent:g} m, expected more than 0 and at most 2')
    targets = [options.output / f'{options.name}_{i + 1}'
               for i in range(len(lasa.strokes(options.name)))]
    taken = [str(target) for target in targets if target.exists()]
    if taken and not options.force:
        raise DataError(f'{taken[0]}: exists already; use --force to replace it')
    shown = lasa.robot_demonstrations(options.name, options.k_min, options.k_max, options.extent)
    with progress('recording', len(targets)) as step:
        for i, (target, demonstration) in enumerate(zip(targets, shown)):
            recordings.replace(target, demonstration, options.frame, EPOCH_NS + i * 60 * NS,
                               options.storage)
            step()
    print(f'wrote {len(targets)} recordings: {targets[0]} … {targets[-1].name}')


def _archives(options: argparse.Namespace) -> None:
    """Write the classes on a manifold."""
    names = lasa.CLASSES if options.name == 'all' else (options.name,)
    targets = {name: options.output / f'{name}_{options.manifold}.npz' for name in names}
    taken = [str(target) for target in targets.values() if target.exists()]
    if taken and not options.force:
        raise DataError(f'{taken[0]}: exists already; use --force to replace it')
    with progress('mapping', len(names)) as step:
        for name, target in targets.items():
            arrays = {}
            for number, shown in enumerate(lasa.data_set(name, options.manifold), 1):
                arrays[f'times_{number}'], arrays[f'points_{number}'] = shown.times, shown.points
            options.output.mkdir(parents=True, exist_ok=True)
            archives.write(target, arrays)
            step()
    print(f'wrote {len(names)} archives of {options.manifold}: {next(iter(targets.values()))} …')

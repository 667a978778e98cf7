"""Write handwriting of people as demonstrations: rosbag2 recordings, or data on a manifold.

As recordings, the LASA handwriting data set becomes motions of a tool in a Panda's workspace: the
letter is scaled to 25 cm and lies on a slightly curved surface, the tool points down and leans
into the stroke. The stiffness comes from the variance over the strokes (Gaussian mixture
regression).

With --manifold it becomes the Riemannian LASA data set: one NumPy archive per class with the
arrays times_1, points_1, times_2, … of every demonstration, on R2, S2, S3, SO3 or SPD2, or the
covariances of the class over time. Arguments that concern bags and robots are then not used.

examples:
  gdmp examples lasa GShape -o demos
  gdmp examples lasa all --manifold S3 -o riemannian
"""
from __future__ import annotations

import argparse

from gdmp_ros.choices import check_lasa_class, LASA_CLASSES, LASA_COVARIANCES, LASA_MANIFOLDS
from gdmp_ros.cli.arguments import (
    add_bag_output,
    add_output,
    add_overwrite,
    add_stiffness_range,
    check_free,
    number,
)
from gdmp_ros.errors import DataError
from gdmp_ros.util.terminal import progress

#: Time between the first stamps of two recordings [s].
_SPACING_S = 60


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('name', metavar='CLASS',
                        help=f'class, one of {", ".join(LASA_CLASSES)}; with --manifold also all')
    parser.add_argument('--manifold', choices=[*LASA_MANIFOLDS, LASA_COVARIANCES],
                        help='write the Riemannian data set as NumPy archives instead of bags')
    add_output(parser, 'DIR', 'folder for the bags CLASS_1, CLASS_2, …, or for the archives')
    add_bag_output(parser)
    parser.add_argument('--extent', type=number(above=0.0, high=2.0), default=0.25, metavar='M',
                        help='size of the letter [m] (default %(default)s)')
    add_stiffness_range(parser)
    add_overwrite(parser)


def run(options: argparse.Namespace) -> None:
    """Write; nothing is written unless all names are free."""
    if not (options.manifold and options.name == 'all'):
        check_lasa_class(options.name)
    if not options.manifold:
        _write_bags(options)
        return
    try:
        _write_archives(options)
    except OSError as error:
        raise DataError(f'{options.output}: cannot write: {error.strerror}') from None


def _write_bags(options: argparse.Namespace) -> None:
    from gdmp_ros.data import lasa, recordings
    from gdmp_ros.data.bags import NS
    targets = [options.output / f'{options.name}_{i + 1}'
               for i in range(len(lasa.strokes(options.name)))]
    check_free(targets, options.overwrite)
    demos = lasa.robot_demonstrations(options.name, options.k_min, options.k_max, options.extent)
    with progress('recording', len(targets)) as step:
        for i, (target, demonstration) in enumerate(zip(targets, demos)):
            recordings.overwrite(target, demonstration, options.frame,
                                 recordings.EPOCH_NS + i * _SPACING_S * NS, options.storage)
            step()
    print(f'wrote {len(targets)} recordings: {targets[0]} … {targets[-1].name}')


def _write_archives(options: argparse.Namespace) -> None:
    from gdmp_ros.data import lasa
    from gdmp_ros.util.files import write_archive
    names = LASA_CLASSES if options.name == 'all' else (options.name,)
    targets = {name: options.output / f'{name}_{options.manifold}.npz' for name in names}
    check_free(targets.values(), options.overwrite)
    with progress('mapping', len(names)) as step:
        for name, target in targets.items():
            arrays = {}
            for number, demo in enumerate(lasa.data_set(name, options.manifold), 1):
                arrays[f'times_{number}'], arrays[f'points_{number}'] = demo.times, demo.points
            options.output.mkdir(parents=True, exist_ok=True)
            write_archive(target, arrays)
            step()
    print(f'wrote {len(names)} archives of {options.manifold}: {next(iter(targets.values()))} …')

"""List the takes of a demonstration, compare them, and drop outliers.

Takes are compared point by point along their paths, so they may differ in tempo. A take is an
outlier if it differs from the others much more than they differ from each other.

examples:
  gdmp takes takes
  gdmp takes takes --drop take_003
  gdmp takes takes --plot takes.png
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.cli.arguments import add_import, add_pose_topic, check_output, import_settings
from gdmp_ros.util.terminal import progress, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='of rosbag2 recordings')
    parser.add_argument('--drop', nargs='+', default=[], metavar='TAKE',
                        help='move takes to FOLDER/dropped')
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw them')
    add_pose_topic(parser)
    add_import(parser)


def run(options: argparse.Namespace) -> None:
    """Drop takes, then compare the others."""
    check_output(options.plot, '.png', '.pdf', '.svg')
    from gdmp_ros.data import recordings, takes
    for name in options.drop:
        print(f'dropped: moved to {takes.drop(options.folder, name)}')
    bags = takes.bags_in(options.folder)
    with progress('reading', len(bags)) as step:
        loaded = []
        for bag in bags:
            loaded.append(recordings.read(bag, options.pose_topic,
                                           settings=import_settings(options)))
            step()
    compared = takes.compare(loaded)
    table(str(options.folder), ['take', 'duration [s]', 'path length [m]',
                                'distance from the others [mm]', 'angle [rad]', ''],
          [[item.name, f'{item.duration:.2f}', f'{item.length:.3f}', f'{1e3 * item.distance:.1f}',
            f'{item.angle:.3f}', 'outlier' if item.outlier else ''] for item in compared])
    for item in compared:
        if item.outlier:
            print(f'{item.name} is an outlier: {item.outlier}')
            print(f'  gdmp takes {options.folder} --drop {item.name}')
    if options.plot:
        from gdmp_ros.view import plots, skill_plots
        plots.save(skill_plots.takes_figure([recording.demonstration for recording in loaded],
                                            [item.name for item in compared],
                                            [bool(item.outlier) for item in compared]),
                   options.plot)
        print(f'wrote {options.plot}')

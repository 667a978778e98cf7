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

from gdmp_ros.cli.arguments import add_pose_topic, check_output
from gdmp_ros.util.terminal import progress, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='of rosbag2 recordings')
    parser.add_argument('--drop', nargs='+', default=[], metavar='TAKE',
                        help='move takes to FOLDER/dropped')
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw them')
    add_pose_topic(parser)


def run(options: argparse.Namespace) -> None:
    """Drop takes, then compare the others."""
    check_output(options.plot, '.png', '.pdf', '.svg')
    from gdmp_ros.data import recordings, takes
    for name in options.drop:
        print(f'dropped: moved to {takes.drop(options.folder, name)}')
    bags = takes.bags_in(options.folder)
    with progress('reading', len(bags)) as step:
        shown = []
        for bag in bags:
            shown.append(recordings.read(bag, options.pose_topic))
            step()
    compared = takes.compare(shown)
    table(str(options.folder), ['take', 'duration [s]', 'path length [m]',
                                'distance from the others [mm]', 'angle [rad]', ''],
          [[one.name, f'{one.duration:.2f}', f'{one.length:.3f}', f'{1e3 * one.distance:.1f}',
            f'{one.angle:.3f}', 'outlier' if one.outlier else ''] for one in compared])
    for one in compared:
        if one.outlier:
            print(f'{one.name} is an outlier: {one.outlier}')
            print(f'  gdmp takes {options.folder} --drop {one.name}')
    if options.plot:
        from gdmp_ros.view import plots, skill_plots
        plots.save(skill_plots.takes_figure([one.demonstration for one in shown],
                                            [one.name for one in compared],
                                            [bool(one.outlier) for one in compared]),
                   options.plot)
        print(f'wrote {options.plot}')

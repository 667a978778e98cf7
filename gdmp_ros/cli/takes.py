"""List the takes of a demonstration, compare them, and put the bad ones aside.

Takes are compared place by place along their paths, so that they may have been shown at different
tempos. A take that differs from the others much more than they do among each other is named.

examples:
  gdmp takes takes
  gdmp takes takes --drop take_003
  gdmp takes takes --plot takes.png
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.data import recordings, takes
from gdmp_ros.util.terminal import progress, table

HELP = 'list, compare and drop takes of a demonstration'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='of rosbag2 recordings')
    parser.add_argument('--drop', nargs='+', default=[], metavar='TAKE',
                        help='put takes aside, to FOLDER/dropped')
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw them')
    parser.add_argument('--pose-topic', default='', metavar='TOPIC',
                        help='where the bags have several')


def run(options: argparse.Namespace) -> None:
    """Drop what is to be dropped, then compare the rest."""
    for name in options.drop:
        print(f'put aside: {takes.drop(options.folder, name)}')
    bags = takes.folder_of(options.folder)
    with progress('reading', len(bags)) as step:
        shown = []
        for bag in bags:
            shown.append(recordings.read(bag, options.pose_topic))
            step()
    compared = takes.compare(shown)
    table(str(options.folder), ['take', 'duration [s]', 'path [m]', 'from the others [mm]',
                                'rotation [rad]', ''],
          [[one.name, f'{one.duration:.2f}', f'{one.length:.3f}', f'{1e3 * one.away:.1f}',
            f'{one.turned:.3f}', 'differs' if one.differs else ''] for one in compared])
    for one in compared:
        if one.differs:
            print(f'{one.name} differs: {one.differs}')
            print(f'  gdmp takes {options.folder} --drop {one.name}')
    if options.plot:
        from gdmp_ros.view import plots
        plots.save(skill_plots.takes_figure([one.demonstration for one in shown],
                                      [one.name for one in compared],
                                      [bool(one.differs) for one in compared]), options.plot)
        print(f'wrote {options.plot}')

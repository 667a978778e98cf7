"""Learn a skill from recorded demonstrations.

Pose comes from a PoseStamped topic (or gdmp_msgs/Reference), stiffness from a Float64MultiArray
with 9 or 36 numbers where the bag has one. Rest at both ends is cut off. Several demonstrations
may have their own starts, goals and durations.

examples:
  gdmp learn demos/GShape_1 -o skill.json
  gdmp learn demos/GShape_* -o skill.json --n-basis 80
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from gdmp_ros.dmp import Skill
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.skill import CONNECTIONS
from gdmp_ros.errors import DataError
from gdmp_ros.files import recordings
from gdmp_ros.terminal import progress, table

HELP = 'learn a skill from rosbag2 demonstrations'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='rosbag2 folders')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='SKILL',
                        help='skill file to write (JSON)')
    parser.add_argument('--pose-topic', default='', metavar='TOPIC',
                        help='where the bag has several')
    parser.add_argument('--stiffness-topic', default='', metavar='TOPIC',
                        help='where the bag has several')
    parser.add_argument('--n-basis', type=int, default=60, metavar='N',
                        help='basis functions (default %(default)s)')
    parser.add_argument('--connection', choices=CONNECTIONS, default='parallel',
                        help="exact transport, or the paper's (default %(default)s)")
    parser.add_argument('--json', action='store_true', help='print a report as JSON')


def run(options: argparse.Namespace) -> None:
    """Learn, write the skill and report how well it reproduces the demonstrations."""
    shown = []
    with progress('reading', len(options.bags)) as step:
        for bag in options.bags:
            shown.append(recordings.read(bag, options.pose_topic, options.stiffness_topic))
            step()
    frames = {recording.frame for recording in shown}
    if len(frames) > 1:
        raise DataError(f'the demonstrations are in different frames: {", ".join(sorted(frames))}')
    demonstrations = [recording.demonstration for recording in shown]
    skill = Skill.learn(demonstrations, options.n_basis, connection=options.connection,
                        provenance={'demonstrations': [str(bag) for bag in options.bags],
                                    'frame': shown[0].frame})
    skill.save(options.output)
    errors = reproduction_error(skill, demonstrations)
    if options.json:
        print(json.dumps({'skill': str(options.output), 'demonstrations': len(shown),
                          'duration': skill.duration,
                          'mean_relative_error': float(errors.mean())}))
        return
    names = ' × '.join(skill.manifold.names)
    table(f'{options.output}', ['demonstrations', 'of', 'duration [s]', 'basis functions',
                                'mean error / span'],
          [[len(shown), names, f'{skill.duration:.3f}', skill.n_basis,
            f'{float(np.mean(errors)):.2e}']])

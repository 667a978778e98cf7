"""Suggest how to learn from demonstrations, and limits for their execution.

Tries numbers of basis functions, also on demonstrations that were left out, and goal switches with
several gains. The variance of the demonstrations determines the stiffness. Nothing is changed: the
suggestions are printed as commands, and with --write as parameters.

examples:
  gdmp tune takes
  gdmp tune demos/GShape_* --plot tune.png --write tuned.yaml
  trajectory_server --ros-args --params-file tuned.yaml -p skill:=skill.json
"""
from __future__ import annotations

import argparse
from collections.abc import Sequence
import math
from pathlib import Path
import shlex
from typing import TYPE_CHECKING

from gdmp_ros.cli.arguments import add_bags, check_number, check_output
from gdmp_ros.util.terminal import progress, table

if TYPE_CHECKING:
    from gdmp_ros.data.recordings import Recording
    from gdmp_ros.dmp.demonstration import Demonstration
    from gdmp_ros.learning.tuning import BasisError, GoalSwitch, Speeds

#: Limits are this many times the demonstrated values.
MARGIN = 1.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_bags(parser)
    parser.add_argument('--force', type=float, default=10.0, metavar='N',
                        help='force of the robot at a deviation of two standard deviations [N] '
                             '(default %(default)g)')
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw the results')
    parser.add_argument('--write', type=Path, metavar='YAML',
                        help='write parameters of trajectory_server and panda_sim')


def run(options: argparse.Namespace) -> None:
    """Try, print, write."""
    check_output(options.plot, '.png', '.pdf', '.svg')
    check_number('--force', options.force, above=0.0)
    import numpy as np

    from gdmp_ros.data import recordings
    from gdmp_ros.data.takes import bags_in
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.learning import tuning
    bags = [result for given in options.bags for result in bags_in(given)]
    with progress('trying', len(bags) + len(tuning.COUNTS) + 1) as step:
        recorded = []
        for bag in bags:
            recorded.append(recordings.read(bag, options.pose_topic))
            step()
        poses, _ = recordings.with_stiffness(recorded, 'none')
        errors = tuning.basis_errors(poses, step)
        count = tuning.sufficient_basis(errors)
        skill = Skill.learn(poses, count)
        span = max(float(np.linalg.norm(pose.points[:, :3] - pose.points[0, :3], axis=1).max())
                   for pose in poses)
        switches = tuning.goal_switches(skill, span) if span >= tuning.SMALLEST_SPAN else []
        step()
    gain = tuning.smooth_gain(switches) if switches else skill.gains.alpha_g
    fastest = tuning.speeds(poses, skill)
    _print_results(errors, count, switches, gain)
    print(f'largest speeds: {fastest.speed:.3f} m/s, {fastest.angular_speed:.3f} rad/s, '
          f'{fastest.acceleration:.2f} m/s²')
    words = ['gdmp', 'learn', *map(str, options.bags), '-o', 'skill.json', '--n-basis',
             str(count), '--alpha-g', f'{gain:g}',
             *(['--pose-topic', options.pose_topic] if options.pose_topic else []),
             *_stiffness(recorded, poses, options.force)]
    print(f'learn with:\n  {shlex.join(words)}')
    if options.write:
        from gdmp_ros.util.files import write_text
        write_text(options.write, _parameters(fastest))
        print(f'wrote {options.write}: for trajectory_server and panda_sim, '
              f'--ros-args --params-file {options.write}')
    if options.plot:
        from gdmp_ros.view import plots, skill_plots
        plots.save(skill_plots.tuning_figure(errors, count, switches, gain), options.plot)
        print(f'wrote {options.plot}')


def _print_results(errors: Sequence[BasisError], count: int, switches: Sequence[GoalSwitch],
                   gain: float) -> None:
    several = not math.isnan(errors[0].unseen)
    table('basis functions: mean distance / span',
          ['', 'from the finest', 'from the training data', 'from one left out'],
          [[f'{error.functions}{"  <- sufficient" if error.functions == count else ""}',
            f'{error.detail:.2e}', f'{error.training:.2e}',
            f'{error.unseen:.2e}' if several else '-']
           for error in errors])
    if not switches:
        print('goal gain: the position hardly moves, no goal was switched')
        return
    table('goal gain: a switch half-way by a quarter of the span',
          ['', 'added acceleration', 'reached after'],
          [[f'{switch.gain:g}{"  <- smooth" if switch.gain == gain else ""}',
            f'{switch.acceleration:.2f} x its own', f'{switch.reached:.2f} durations']
           for switch in switches])


def _stiffness(recorded: Sequence[Recording], poses: Sequence[Demonstration], force: float
               ) -> list[str]:
    """Print the source of the stiffness; words for ``gdmp learn``."""
    from gdmp_ros.learning import tuning
    if all(len(item.demonstration.points[0]) > 7 for item in recorded):
        print('stiffness: as recorded')
        return []
    if len(poses) < 2:
        print('stiffness: one demonstration does not determine it; record two takes or more')
        return []
    low, high = tuning.stiffness_bounds(poses, force)
    print(f'stiffness: {low:.0f} to {high:.0f} N/m give {force:g} N at two standard deviations')
    return ['--stiffness', 'variance', '--k-min', f'{low:.0f}', '--k-max', f'{high:.0f}']


def _parameters(fastest: Speeds) -> str:
    """Parameters that limit the robot to little more than was demonstrated."""
    speed, angular_speed = max(fastest.speed, 0.05), max(fastest.angular_speed, 0.3)
    acceleration = max(2.0 * MARGIN * fastest.acceleration, 0.5)
    return (f'# Speeds: {MARGIN:g} times those of the demonstrations. Accelerations: '
            f'{2.0 * MARGIN:g} times.\n# Goal speeds: as demonstrated. Slow demonstrations have '
            'lower bounds.\n'
            '/**/trajectory_server:\n  ros__parameters:\n'
            f'    goal_speed: {speed:.4f}\n    goal_angular_speed: {angular_speed:.4f}\n'
            '/**/panda_sim:\n  ros__parameters:\n'
            f'    speed: {min(MARGIN * speed, 1.7):.4f}\n'
            f'    angular_speed: {min(MARGIN * angular_speed, 2.5):.4f}\n'
            f'    acceleration: {min(acceleration, 13.0):.4f}\n')

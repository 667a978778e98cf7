"""Suggest how to learn from demonstrations, and with which limits to execute it.

Numbers of basis functions are tried, also on demonstrations that were left out; goals are switched
with different gains; what the demonstrations agree on gives the stiffness. Nothing is changed: the
suggestions are printed as commands, and written as parameters where --write is given.

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

import numpy as np

from gdmp_ros.cli.learn import bags_in
from gdmp_ros.data import recordings
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.errors import ParameterError
from gdmp_ros.learning import tuning
from gdmp_ros.util.atomic_write import write_text
from gdmp_ros.util.terminal import progress, table

HELP = 'suggest basis functions, gains, stiffness and limits from demonstrations'
#: A limit lets through so many times what was demonstrated.
MARGIN = 1.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='rosbag2 folders, or folders of them')
    parser.add_argument('--force', type=float, default=10.0, metavar='N',
                        help='how hard the robot may pull where it is two standard deviations '
                             'off (default %(default)g)')
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw what was tried')
    parser.add_argument('--write', type=Path, metavar='YAML',
                        help='write parameters of trajectory_server and panda_sim')
    parser.add_argument('--pose-topic', default='', metavar='TOPIC',
                        help='where the bags have several')


def run(options: argparse.Namespace) -> None:
    """Try, print, write."""
    if not (math.isfinite(options.force) and options.force > 0.0):
        raise ParameterError(f'--force is {options.force:g} N, expected more than 0')
    bags = [found for given in options.bags for found in bags_in(given)]
    with progress('trying', len(bags) + len(tuning.COUNTS) + 1) as step:
        recorded = []
        for bag in bags:
            recorded.append(recordings.read(bag, options.pose_topic))
            step()
        poses, _ = recordings.stiffened(recorded, 'none')
        errors = tuning.basis_errors(poses, step)
        count = tuning.enough(errors)
        skill = Skill.learn(poses, count)
        span = max(float(np.linalg.norm(one.points[:, :3] - one.points[0, :3], axis=1).max())
                   for one in poses)
        switches = tuning.goal_switches(skill, span) if span >= tuning.LEAST_SPAN else []
        step()
    gain = tuning.calm_gain(switches) if switches else skill.gains.alpha_g
    fastest = tuning.speeds(poses, skill)
    _show(errors, count, switches, gain)
    words = ['gdmp', 'learn', *map(str, options.bags), '-o', 'skill.json', '--n-basis',
             str(count), '--alpha-g', f'{gain:g}',
             *(['--pose-topic', options.pose_topic] if options.pose_topic else []),
             *_stiffness(recorded, poses, options.force)]
    print(f'largest speeds: {fastest.speed:.3f} m/s, {fastest.turn_speed:.3f} rad/s, '
          f'{fastest.acceleration:.2f} m/s²')
    print(f'learn with:\n  {shlex.join(words)}')
    if options.write:
        write_text(options.write, _parameters(fastest))
        print(f'wrote {options.write}: with trajectory_server and panda_sim, '
              f'--ros-args --params-file {options.write}')
    if options.plot:
        from gdmp_ros.view import plots
        plots.save(skill_plots.tuning_figure(errors, count, switches, gain), options.plot)
        print(f'wrote {options.plot}')


def _show(errors: Sequence[tuning.BasisError], count: int,
          switches: Sequence[tuning.GoalSwitch], gain: float) -> None:
    several = not math.isnan(errors[0].unseen)
    table('basis functions: mean distance / span', ['', 'from the finest', 'from what was shown',
                                                    'from one left out'], [
        [f'{one.functions}{"  <- enough" if one.functions == count else ""}',
         f'{one.detail:.2e}', f'{one.shown:.2e}', f'{one.unseen:.2e}' if several else '-']
        for one in errors])
    if not switches:
        print('goal gain: the position hardly moves, no goal was switched')
        return
    table('goal gain: a switch half-way by a quarter of the span', [
        '', 'adds acceleration', 'reached after'], [
        [f'{one.gain:g}{"  <- calm" if one.gain == gain else ""}',
         f'{one.acceleration:.2f} x its own', f'{one.reached:.2f} durations']
        for one in switches])


def _stiffness(recorded: Sequence[recordings.Recording], poses: Sequence[Demonstration],
               force: float) -> list[str]:
    """Words for ``gdmp learn``, after saying where they come from."""
    if all(len(one.demonstration.points[0]) > 7 for one in recorded):
        print('stiffness: was recorded, and is taken as it is')
        return []
    if len(poses) < 2:
        print('stiffness: one demonstration says nothing about it; show it again, twice at least')
        return []
    low, high = tuning.stiffness_bounds(poses, force)
    print(f'stiffness: {low:.0f} to {high:.0f} N/m pull with {force:g} N at two standard '
          'deviations')
    return ['--stiffness', 'variance', '--k-min', f'{low:.0f}', '--k-max', f'{high:.0f}']


def _parameters(fastest: tuning.Speeds) -> str:
    """Parameters that keep the robot near what was demonstrated."""
    speed, turn_speed = max(fastest.speed, 0.05), max(fastest.turn_speed, 0.3)
    acceleration = max(2.0 * MARGIN * fastest.acceleration, 0.5)
    return (f'# Speeds {MARGIN:g} times and accelerations {2.0 * MARGIN:g} times what the '
            'demonstrations have,\n# goals at their speed; never less than what a slow motion '
            'needs.\n'
            '/**/trajectory_server:\n  ros__parameters:\n'
            f'    goal_speed: {speed:.4f}\n    goal_turn_speed: {turn_speed:.4f}\n'
            '/**/panda_sim:\n  ros__parameters:\n'
            f'    speed: {min(MARGIN * speed, 1.7):.4f}\n'
            f'    turn_speed: {min(MARGIN * turn_speed, 2.5):.4f}\n'
            f'    acceleration: {min(acceleration, 13.0):.4f}\n')

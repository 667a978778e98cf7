"""Learn a skill from recorded demonstrations, or suggest how.

Poses come from a PoseStamped topic (or gdmp_msgs/Reference), the stiffness from a
Float64MultiArray with 9 or 36 numbers if the bag has one. Otherwise several takes determine the
stiffness: high where they agree, low where they vary. Rest at both ends is cut off. Several
demonstrations may have different starts, goals and durations. A folder stands for all bags in it.

With --rhythmic the skill repeats a cycle, such as wiping or stirring. Each bag shows two cycles or
more; the period is found, and the way to the first cycle and from the last one is left out.

With --frames the motion belongs to objects: it is learned as seen from each of them, and how much
each one matters along the way (gdmp rollout --object, gdmp check --object).

Files of other programs are read too: what their columns and arrays mean is told by their names and
printed. Where two readings fit, the error names the option to give.

With --suggest nothing is learned: numbers of basis functions are tried, also on demonstrations
that were left out, and goal switches with several gains; the variance of the demonstrations
determines the stiffness. The suggestions are printed as a command, and with --write as parameters.

examples:
  gdmp learn demos/GShape_1 -o skill.json
  gdmp learn demos/GShape_* -o skill.json --tolerance 1e-3
  gdmp learn recorded.bag -o skill.json --end moving
  gdmp learn first.bag second.bag -o skill.json --weights 1 3
  gdmp learn takes -o skill.json --joints
  gdmp learn dataset -o skill.json --joints action --units deg
  gdmp learn takes -o skill.json --contexts heights.csv
  gdmp learn takes -o insert.json --frames box hole
  gdmp learn wiping.bag -o wipe.json --rhythmic
  gdmp learn optitrack.csv -o skill.json --drop-bad
  gdmp learn takes --suggest --write tuned.yaml
  gdmp learn demos -o skills --each --jobs 4 --resume done.jsonl
"""
from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
import math
from pathlib import Path
import shlex
from typing import Any, TYPE_CHECKING

from gdmp_ros.choices import CONNECTIONS, ENDS, FITS, STIFFNESSES
from gdmp_ros.cli.arguments import (
    add_bags,
    add_import,
    add_output,
    add_parallel,
    add_stiffness_range,
    check_output,
    import_settings,
    number,
)
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.util.terminal import progress, table

if TYPE_CHECKING:
    from gdmp_ros.data.recordings import Recording
    from gdmp_ros.data.skills import LearningSettings
    from gdmp_ros.dmp.demonstration import Demonstration
    from gdmp_ros.learning.report import Fit
    from gdmp_ros.learning.tuning import BasisError, GoalSwitch, Speeds

#: Samples of a demonstration that may be wrong: most that are listed.
MOST_SUSPICIONS = 5
#: Most demonstrations that are listed.
MOST_DEMONSTRATIONS = 20
#: Limits are this many times the demonstrated values.
MARGIN = 1.5

#: Of the distances by factor. A turn by 1 rad is 0.5 on the sphere of unit quaternions.
_UNITS = {'position': ' [m]', 'orientation': ' [rad / 2]', 'joints': ' [rad]',
          'wrench': ' [N, Nm]', 'stiffness': ' [log]'}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_bags(parser)
    add_import(parser)
    add_output(parser, 'SKILL', 'skill file to write (JSON); with --each a folder for them',
               required=False)
    parser.add_argument('--each', action='store_true', help='learn one skill from each bag')
    parser.add_argument('--rhythmic', action='store_true',
                        help='learn a motion that repeats the cycle that the bags show')
    parser.add_argument('--period', type=number(above=0.0), metavar='S',
                        help='with --rhythmic: period of the cycle (default: it is measured)')
    parser.add_argument('--stiffness-topic', default='', metavar='TOPIC',
                        help='topic of the stiffness, if a bag has several')
    parser.add_argument('--wrench-topic', default='', metavar='TOPIC',
                        help='WrenchStamped that a sensor measured at the tool, in the frame of '
                        'the poses: the skill then exerts the opposite (default: no wrench)')
    parser.add_argument('--joints', nargs='?', const='', default=None, metavar='TOPIC',
                        dest='joint_topic',
                        help='learn a skill of the joints, from this JointState topic, or from '
                             'the only one; of a data set from this feature, such as action: '
                             'with the gripper, as it was commanded')
    parser.add_argument('--stiffness', choices=STIFFNESSES, default='auto',
                        help='recorded; variance: high where the takes agree, low where they '
                        'vary; none; auto (default): recorded, else variance if there are two '
                        'takes or more')
    add_stiffness_range(parser)
    parser.add_argument('--n-basis', type=_count, default='auto', metavar='N',
                        help='number of basis functions, or auto (default): as few as describe '
                             'the data as well as any number')
    parser.add_argument('--tolerance', type=number(above=0.0), default=1e-4, metavar='E',
                        help='for auto: mean error / span that is good enough '
                             '(default %(default)s)')
    parser.add_argument('--smooth', type=number(above=0.0), metavar='HZ',
                        help='cut-off frequency of smoothing: gain 1/2 at this frequency')
    parser.add_argument('--regularization', type=number(0.0), default=0.0, metavar='R',
                        help='with --fit forcing: ridge of the regression, 1e-3 to 1e-1 for '
                             'noisy data')
    parser.add_argument('--weights', type=float, nargs='+', metavar='W',
                        help='how much each demonstration counts, in the order of the bags '
                             '(default: alike)')
    parser.add_argument('--contexts', type=Path, metavar='CSV',
                        help='table of what was different in each take: a column "take" with the '
                             'names of the bags, and a column for each number, such as height')
    _add_task_frames(parser)
    parser.add_argument('--fit', choices=FITS, default='output',
                        help='output (default): fit the motion, for recorded data; forcing: fit '
                             'the forcing term, as in the paper, for clean data')
    parser.add_argument('--end', choices=ENDS,
                        help='how the motion ends: at rest at its goal (default of --fit output), '
                             'or moving as demonstrated (default of --fit forcing)')
    parser.add_argument('--alpha-g', type=float, metavar='G',
                        help='gain of the moving goal: a larger gain reaches a new goal sooner, '
                             'with more acceleration (default 8, with --rhythmic 4)')
    parser.add_argument('--connection', choices=CONNECTIONS, default='parallel',
                        help="exact transport, or the paper's (default %(default)s)")
    parser.add_argument('--json', action='store_true', help='print a report as JSON')
    add_parallel(parser)
    suggest = parser.add_argument_group('suggestions')
    suggest.add_argument('--suggest', action='store_true',
                         help='suggest basis functions, gains, stiffness and limits')
    suggest.add_argument('--force', type=number(above=0.0), default=10.0, metavar='N',
                         help='of the robot at a deviation of two standard deviations [N] '
                              '(default %(default)g)')
    suggest.add_argument('--plot', type=Path, metavar='PNG', help='draw the results')
    suggest.add_argument('--write', type=Path, metavar='YAML',
                         help='write parameters of trajectory_server and panda_sim')


def _add_task_frames(parser: argparse.ArgumentParser) -> None:
    objects = parser.add_argument_group('task frames')
    objects.add_argument('--frames', nargs='+', default=[], metavar='NAME',
                         help='objects, by the names of their frames in /tf and /tf_static, or '
                              'NAME=/TOPIC of a PoseStamped; in files of other programs by '
                              'their columns, or NAME=COLUMN: the skill is then done where they '
                              'are')
    objects.add_argument('--object-table', type=Path, metavar='CSV',
                         help='where objects are in each take: a column "take" with the names of '
                              'the bags, and columns NAME.x, .y, .z, .qw, .qx, .qy, .qz')
    objects.add_argument('--moving', nargs='+', default=[], metavar='NAME',
                         help='those of them that move while they are shown')
    objects.add_argument('--start-frame', metavar='NAME',
                         help='the object that the motion leaves (default: start, or the first)')
    objects.add_argument('--goal-frame', metavar='NAME',
                         help='the object where it ends (default: goal, or the last)')
    objects.add_argument('--free-yaw', nargs='+', default=[], metavar='NAME',
                         help='those of them that are symmetric about their z axis, as a cup is: '
                              'the nearest turn about it is taken')


def _count(text: str) -> int | str:
    return text if text == 'auto' else int(text)


def run(options: argparse.Namespace) -> None:
    """Learn, write the skill and report how accurately it reproduces the demonstrations."""
    from gdmp_ros.data.skills import LearningSettings
    from gdmp_ros.data.takes import bags_in
    if options.suggest:
        _suggest(options)
        return
    if options.output is None:
        raise ParameterError('-o SKILL is missing: the skill file to write (or --suggest)')
    if not options.each:
        check_output(options.output)
    bags = [result for given in options.bags for result in bags_in(given)]
    settings = LearningSettings(
        options.n_basis, options.connection, options.tolerance, options.smooth,
        options.regularization, options.alpha_g, options.stiffness, options.k_min, options.k_max,
        options.pose_topic, options.stiffness_topic, options.wrench_topic,
        options.joint_topic, fit=options.fit,
        end=options.end, weights=options.weights and tuple(options.weights),
        rhythmic=options.rhythmic, period=options.period, contexts=options.contexts,
        objects=tuple(options.frames), object_table=options.object_table,
        moving=tuple(options.moving),
        ends=(options.start_frame, options.goal_frame), free_yaw=tuple(options.free_yaw),
        source=import_settings(options))
    if options.weights and (options.each or len(options.weights) != len(bags)):
        raise ParameterError(f'--weights: {len(options.weights)} numbers for {len(bags)} '
                             'demonstrations of one skill, expected one for each')
    if options.contexts and options.each:
        raise ParameterError('--contexts: takes of several contexts make one skill, not --each')
    if options.each:
        _learn_each(bags, settings, options)
        return
    with progress('reading and learning', len(bags) + 1) as step:
        fit, duration = learn(bags, settings, options.output, step)
        step()
    mean_error = sum(d.relative_error for d in fit.demonstrations) / len(bags)
    if options.json:
        print(json.dumps({'skill': str(options.output), 'demonstrations': len(bags),
                          'duration': duration, 'mean_relative_error': mean_error,
                          'n_basis': fit.n_basis, 'fit': _as_document(fit)}))
        return
    table(f'{options.output}', ['takes', 'factors',
                                'period [s]' if options.rhythmic else 'duration [s]', 'functions',
                                'condition', 'mean error / span'],
          [[len(bags), ' × '.join(fit.factors), f'{duration:.3f}', fit.n_basis,
            f'{fit.condition:.0f}', f'{mean_error:.2e}']])
    _print_details(bags, fit)


def learn(bags: list[Path], settings: LearningSettings, output: Path,
          step: Any = lambda: None) -> tuple[Fit, float]:
    """Learn one skill from ``bags`` and write it; its fit and its duration."""
    from gdmp_ros.data.skills import skill_from_bags
    from gdmp_ros.learning.report import fit_report
    learned = skill_from_bags(bags, settings, step)
    learned.skill.save(output)
    return fit_report(learned.skill, learned.demonstrations), learned.skill.duration


def _learn_each(bags: list[Path], settings: LearningSettings, options: argparse.Namespace) -> None:
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    if len({bag.name for bag in bags}) < len(bags):
        raise DataError('--each names the skills after the bags: two have the same name')
    options.output.mkdir(parents=True, exist_ok=True)
    tasks = {str(bag.resolve()): (bag, settings, options.output / f'{bag.name}.json')
             for bag in bags}
    # A skill that has been removed since is learned again.
    journal = Journal(options.resume, f'skills learned with {settings}')
    for key, (_, _, output) in tasks.items():
        if not output.exists():
            journal.results.pop(key, None)
    done = map_tasks('learning', learn_one, tasks, options.jobs,
                     scheduler_address(options.backend), journal)
    results = [done[key] for key in tasks]
    if options.json:
        print(json.dumps(results))
    else:
        table(f'{options.output}', ['skill', 'duration [s]', 'basis functions',
                                    'mean error / span'],
              [[r['skill'], f'{r["duration"]:.3f}', r['n_basis'],
                f'{r["mean_relative_error"]:.2e}'] if 'error' not in r
               else [r['skill'], 'refused:', '', r['error']] for r in results])
    refused = [r for r in results if 'error' in r]
    if refused:
        raise DataError(f'{len(refused)} of {len(results)} bags were refused; the first: '
                        f'{refused[0]["error"]}')


def learn_one(task: tuple[Path, LearningSettings, Path]) -> dict[str, Any]:
    """Learn one skill; a bag that is refused does not stop the others."""
    bag, settings, output = task
    try:
        fit, duration = learn([bag], settings, output)
    except GdmpError as error:
        return {'skill': output.name, 'error': str(error)}
    return {'skill': output.name, 'duration': duration, 'n_basis': fit.n_basis,
            'mean_relative_error': fit.demonstrations[0].relative_error}


def _as_document(fit: Fit) -> dict[str, Any]:
    demonstrations = [{**d._asdict(), 'suspicions': [s._asdict() for s in d.suspicions]}
                      for d in fit.demonstrations]
    return {**fit._asdict(), 'demonstrations': demonstrations}


def _print_details(bags: list[Path], fit: Fit) -> None:
    """Print errors by factor, segments, and samples that may be wrong."""
    worst = sorted(range(len(bags)), key=lambda i: -fit.demonstrations[i].relative_error)
    most = sorted(worst[:MOST_DEMONSTRATIONS])
    shown = [(bags[i], fit.demonstrations[i]) for i in most]
    if len(bags) > 1 or len(fit.factors) > 1:
        rhythmic = any(d.cycles for d in fit.demonstrations)
        heads = ['demonstration', 'period [s]' if rhythmic else 'duration [s]', 'samples',
                 *(f'{name}{_UNITS.get(name, "")}: mean, largest, noise'
                   for name in fit.factors)]
        title = 'errors by factor' if len(shown) == len(bags) else (
            f'errors by factor: the {len(shown)} demonstrations of {len(bags)} with the largest')
        table(title, heads, [
            [bag.name, f'{d.duration:.3f}', d.samples,
             *(f'{mean:.1e}, {largest:.1e}, {noise:.1e}'
               for mean, largest, noise in zip(d.mean_error, d.largest_error, d.noise))]
            for bag, d in shown])
    for bag, d in shown:
        if d.cycles:
            print(f'{bag.name}: {d.cycles:.1f} cycles of {d.duration:.3f} s, from '
                  f'{d.used[0]:.2f} to {d.used[1]:.2f} s; a cycle ends '
                  + ', '.join(f'{value:.1e}{_UNITS.get(name, "")}'
                              for name, value in zip(fit.factors, d.closing))
                  + ' from where it began')
    if fit.segments:
        at = ', '.join(f'{s:.3f}' for s in fit.segments)
        print(f'the motion passes the cut locus of its goal: it is split into '
              f'{len(fit.segments) + 1} segments at s = {at}')
    for bag, d in shown:
        for result in d.suspicions[:MOST_SUSPICIONS]:
            print(f'{bag.name}: sample {result.sample} (t = {result.time:.3f} s) {result.reason}')
        if len(d.suspicions) > MOST_SUSPICIONS:
            print(f'{bag.name}: and {len(d.suspicions) - MOST_SUSPICIONS} more such samples')


def _suggest(options: argparse.Namespace) -> None:
    """Try, print, write."""
    check_output(options.plot, '.png', '.pdf', '.svg')
    import numpy as np

    from gdmp_ros.data import recordings
    from gdmp_ros.data.takes import bags_in
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.learning import tuning
    bags = [result for given in options.bags for result in bags_in(given)]
    with progress('trying', len(bags) + len(tuning.COUNTS) + 1) as step:
        recorded = []
        for bag in bags:
            recorded.append(recordings.read(bag, options.pose_topic,
                                            settings=import_settings(options)))
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

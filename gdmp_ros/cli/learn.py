"""Learn a skill from recorded demonstrations.

Pose comes from a PoseStamped topic (or gdmp_msgs/Reference), stiffness from a Float64MultiArray
with 9 or 36 numbers where the bag has one; otherwise several takes give it: high where they agree,
low where they vary. Rest at both ends is cut off. Several demonstrations may have their own
starts, goals and durations. A folder stands for all the bags in it.

examples:
  gdmp learn demos/GShape_1 -o skill.json
  gdmp learn demos/GShape_* -o skill.json --n-basis auto --tolerance 2e-4
  gdmp learn noisy.bag -o skill.json --smooth 8 --regularization 1e-3
  gdmp learn demos -o skills --each --jobs 4 --resume done.jsonl
"""
from __future__ import annotations

import argparse
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from gdmp_ros.cli.bench import add_parallel_arguments
from gdmp_ros.data import recordings, takes
from gdmp_ros.dmp import Skill
from gdmp_ros.dmp.primitive import CONNECTIONS
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.learning.report import Fit, fit_report
from gdmp_ros.util.terminal import progress, table

HELP = 'learn a skill from rosbag2 demonstrations'


@dataclass(frozen=True)
class Recipe:
    """How to learn, as the arguments say."""

    pose_topic: str
    stiffness_topic: str
    n_basis: int | str
    connection: str
    tolerance: float
    smoothing: float | None
    regularization: float
    stiffness: str
    k_min: float
    k_max: float
    alpha_g: float


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG',
                        help='rosbag2 folders, or folders of them')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='SKILL',
                        help='skill file to write (JSON); with --each a folder for them')
    parser.add_argument('--each', action='store_true', help='learn one skill from each bag')
    parser.add_argument('--pose-topic', default='', metavar='TOPIC',
                        help='where the bag has several')
    parser.add_argument('--stiffness-topic', default='', metavar='TOPIC',
                        help='where the bag has several')
    parser.add_argument('--stiffness', choices=recordings.STIFFNESSES,
                        default='auto', help='as recorded, or high where the takes agree and low '
                        'where they vary, or none; auto: recorded, else from variance where there '
                        'are two takes or more (default)')
    parser.add_argument('--k-min', type=float, default=200.0, metavar='N/M',
                        help='smallest stiffness from variance (default %(default)g)')
    parser.add_argument('--k-max', type=float, default=800.0, metavar='N/M',
                        help='largest stiffness from variance (default %(default)g)')
    parser.add_argument('--n-basis', type=_count, default=60, metavar='N',
                        help='basis functions, or auto for as few as the tolerance allows '
                             '(default %(default)s)')
    parser.add_argument('--tolerance', type=float, default=1e-4, metavar='E',
                        help='of auto: mean error / span (default %(default)s)')
    parser.add_argument('--smooth', type=float, metavar='HZ',
                        help='cut-off of smoothing: half the amplitude is left there')
    parser.add_argument('--regularization', type=float, default=0.0, metavar='R',
                        help='ridge of the regression, 1e-3 to 1e-1 for noisy data')
    parser.add_argument('--alpha-g', type=float, default=8.0, metavar='G',
                        help='gain of a moving goal: larger reaches it sooner and jerks more '
                             '(default %(default)g)')
    parser.add_argument('--connection', choices=CONNECTIONS, default='parallel',
                        help="exact transport, or the paper's (default %(default)s)")
    parser.add_argument('--json', action='store_true', help='print a report as JSON')
    add_parallel_arguments(parser)


def _count(text: str) -> int | str:
    return text if text == 'auto' else int(text)


def run(options: argparse.Namespace) -> None:
    """Learn, write the skill and report how well it reproduces the demonstrations."""
    bags = [found for given in options.bags for found in bags_in(given)]
    recipe = Recipe(options.pose_topic, options.stiffness_topic, options.n_basis,
                    options.connection, options.tolerance, options.smooth,
                    options.regularization, options.stiffness, options.k_min, options.k_max,
                    options.alpha_g)
    if options.each:
        _learn_each(bags, recipe, options)
        return
    with progress('reading', len(bags)) as step:
        fit, duration = learn(bags, recipe, options.output, step)
    mean_error = sum(d.relative_error for d in fit.demonstrations) / len(bags)
    if options.json:
        print(json.dumps({'skill': str(options.output), 'demonstrations': len(bags),
                          'duration': duration, 'mean_relative_error': mean_error,
                          'n_basis': fit.n_basis, 'fit': _plain(fit)}))
        return
    table(f'{options.output}', ['demos', 'of', 'duration [s]', 'basis', 'condition',
                                'error / span'],
          [[len(bags), ' × '.join(fit.factors), f'{duration:.3f}', fit.n_basis,
            f'{fit.condition:.0f}', f'{mean_error:.2e}']])
    _show(bags, fit)


def learn(bags: list[Path], recipe: Recipe, output: Path,
          step: Any = lambda: None) -> tuple[Fit, float]:
    """Learn one skill from ``bags`` and write it; its fit and its duration."""
    shown = []
    for bag in bags:
        shown.append(recordings.read(bag, recipe.pose_topic, recipe.stiffness_topic))
        step()
    frames = {recording.frame for recording in shown}
    if len(frames) > 1:
        raise DataError(f'the demonstrations are in different frames: {", ".join(sorted(frames))}')
    demonstrations, origin = recordings.stiffened(shown, recipe.stiffness, recipe.k_min,
                                                  recipe.k_max)
    skill = Skill.learn(demonstrations, recipe.n_basis, connection=recipe.connection,
                        tolerance=recipe.tolerance, smoothing=recipe.smoothing,
                        regularization=recipe.regularization, alpha_g=recipe.alpha_g,
                        provenance={'demonstrations': [str(bag) for bag in bags],
                                    'frame': shown[0].frame, 'stiffness': origin})
    skill.save(output)
    return fit_report(skill, demonstrations), skill.duration


def bags_in(given: Path) -> list[Path]:
    """The bag itself, or all those in a folder."""
    if given.is_file() or (given / 'metadata.yaml').exists() or not given.is_dir():
        return [given]
    return takes.folder_of(given)


def _learn_each(bags: list[Path], recipe: Recipe, options: argparse.Namespace) -> None:
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    if len({bag.name for bag in bags}) < len(bags):
        raise DataError('--each names the skills after the bags: two have the same name')
    options.output.mkdir(parents=True, exist_ok=True)
    tasks = {str(bag.resolve()): (bag, recipe, options.output / f'{bag.name}.json')
             for bag in bags}
    # A skill that has been removed since is learned again.
    journal = Journal(options.resume, f'skills learned with {recipe}')
    for key, (_, _, output) in tasks.items():
        if not output.exists():
            journal.results.pop(key, None)
    done = map_tasks('learning', learn_one, tasks, options.jobs, scheduler_address(options.backend), journal)
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


def learn_one(task: tuple[Path, Recipe, Path]) -> dict[str, Any]:
    """Learn one skill; a bag that is refused does not stop the others."""
    bag, recipe, output = task
    try:
        fit, duration = learn([bag], recipe, output)
    except GdmpError as error:
        return {'skill': output.name, 'error': str(error)}
    return {'skill': output.name, 'duration': duration, 'n_basis': fit.n_basis,
            'mean_relative_error': fit.demonstrations[0].relative_error}


def _plain(fit: Fit) -> dict[str, Any]:
    demonstrations = [{**d._asdict(), 'suspicions': [s._asdict() for s in d.suspicions]}
                      for d in fit.demonstrations]
    return {**fit._asdict(), 'demonstrations': demonstrations}


def _show(bags: list[Path], fit: Fit) -> None:
    """Errors by factor where there is more than one demonstration, segments, suspicions."""
    if len(bags) > 1 or len(fit.factors) > 1:
        heads = ['demonstration', 'duration [s]', 'samples',
                 *(f'{name}: mean, largest' for name in fit.factors)]
        table('errors by factor', heads, [
            [bag.name, f'{d.duration:.3f}', d.samples,
             *(f'{mean:.1e}, {most:.1e}' for mean, most in zip(d.mean_error, d.largest_error))]
            for bag, d in zip(bags, fit.demonstrations)])
    if fit.segments:
        at = ', '.join(f'{s:.3f}' for s in fit.segments)
        print(f'the motion leaves the region of its goal: cut into {len(fit.segments) + 1} '
              f'segments at s = {at}')
    for bag, d in zip(bags, fit.demonstrations):
        for found in d.suspicions:
            print(f'{bag.name}: sample {found.sample} (t = {found.time:.3f} s) {found.reason}')

"""Improve a skill by trying: roll-outs are scored, and the skill moves to the better ones.

TASK is `insertion` (a peg and a hole that is off by up to 3 mm, in simulation), a Python file with
a function score(trial) that returns the cost, or an executable that gets a file with the recorded
roll-out and prints the cost. A Python file may have arm(seed) too, which returns the simulated arm
with what is around it. A roll-out that would violate a limit is ended, and scores worst.

While it runs, index.html in the folder shows costs and skills; open it in a browser.

examples:
  gdmp improve insertion -o inserts.json --jobs 2
  gdmp improve reach.py --skill skill.json -o better.json --weights 8 --tempo
  gdmp improve ./score --skill skill.json -o better.json --via 0.3 0.6 --stiffness 1
  gdmp improve insertion -o inserts.json --resume rollouts.jsonl
  gdmp improve insertion -o inserts.json --backend dask 127.0.0.1:8786

The search cma and pages come with: pip install 'gdmp_ros[sim,improve,report]'
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, TYPE_CHECKING

from gdmp_ros.choices import SEARCHES, TASKS_TO_IMPROVE
from gdmp_ros.cli.arguments import add_parallel, check_number, check_output
from gdmp_ros.errors import ParameterError
from gdmp_ros.util.optional_imports import extra, optional_import

if TYPE_CHECKING:
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.improvement.session import Improvement, Job
    from gdmp_ros.improvement.task import Task
    from gdmp_ros.improvement.variables import Variable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('task', metavar='TASK', help=f'{", ".join(TASKS_TO_IMPROVE)}, a Python '
                        'file, or an executable')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='SKILL',
                        help='where the improved skill is written')
    parser.add_argument('--skill', type=Path, metavar='SKILL',
                        help='skill to improve; by default that of the task')
    parser.add_argument('--page', type=Path, metavar='HTML',
                        help='page about the improvement (default: beside the improved skill)')
    effort = parser.add_argument_group('how much is tried')
    effort.add_argument('--updates', type=int, default=12, metavar='N',
                        help='of the search (default %(default)s)')
    effort.add_argument('--samples', type=int, default=10, metavar='N',
                        help='skills that are tried in each update (default %(default)s)')
    effort.add_argument('--situations', type=int, default=4, metavar='N',
                        help='roll-outs of each skill, each in another situation '
                             '(default %(default)s)')
    effort.add_argument('--held-out', type=int, default=20, metavar='N',
                        help='roll-outs before and after, in situations not used for learning '
                             '(default %(default)s)')
    effort.add_argument('--search', choices=SEARCHES, default=SEARCHES[0],
                        help='pibb: reward-weighted averaging with covariance adaptation; cma: '
                             'CMA-ES (default %(default)s)')
    effort.add_argument('--seed', type=int, default=0, metavar='N',
                        help='the same one gives the same skill (default %(default)s)')
    effort.add_argument('--force', type=float, default=100.0, metavar='N',
                        help='external force at which a roll-out is ended [N] '
                             '(default %(default)g)')
    vary = parser.add_argument_group('what varies (by default what the task says)')
    vary.add_argument('--weights', type=int, metavar='N',
                      help='the path, by N bumps for each coordinate of the pose')
    vary.add_argument('--via', type=float, nargs='+', metavar='S',
                      help='the pose at this progress, 0 to 1')
    vary.add_argument('--stiffness', type=int, metavar='N',
                      help='the stiffness at N places; 1: the same factors everywhere')
    vary.add_argument('--tempo', action='store_true', help='the duration')
    vary.add_argument('--by', type=float, nargs=2, default=(5.0, 0.05), metavar=('MM', 'RAD'),
                      help='first standard deviation of positions and rotations (default 5 0.05)')
    add_parallel(parser)


def run(options: argparse.Namespace) -> None:
    """Improve, and write the skill and the page."""
    check_output(options.output, '.json')
    page = options.page or options.output.with_suffix('.html')
    check_output(page, '.html')
    check_number('--force', options.force, above=0.0)
    for value in options.by:
        check_number('--by', value, above=0.0)
    with optional_import(extra('sim')):
        from gdmp_ros.improvement.insertion import Insertion
        from gdmp_ros.improvement.session import Effort, improve, roll_out, subject
        from gdmp_ros.improvement.task import task_from_file
        from gdmp_ros.improvement.variables import Variables
    with optional_import(extra('report')):
        from gdmp_ros.view import improvement_page
    from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address
    insertion = options.task == TASKS_TO_IMPROVE[0]
    task = (Insertion(largest_force=options.force) if insertion
            else task_from_file(Path(options.task), options.force))
    variables = Variables(_skill(options, task), _variables(options, task))
    effort = Effort(options.updates, options.samples, options.situations, options.held_out)
    journal = Journal(options.resume, subject(task, variables, options.search, effort,
                                              options.seed))
    dask = scheduler_address(options.backend)

    def execute(title: str, jobs: dict[str, Job]) -> dict[str, Any]:
        return map_tasks(title, roll_out, jobs, options.jobs, dask, journal)
    print(f'{task.name}: {variables.size} numbers vary, {effort.rollouts} roll-outs; see {page}',
          flush=True)
    state: Improvement | None = None
    for state in improve(task, variables, execute, effort, options.search, options.seed):
        improvement_page.write(state, page, done=False)
        _tell(state)
    if state is None:
        return
    improvement_page.write(state, page, done=True)
    state.skill().save(options.output)
    for name, judged in (('before', state.before), ('after', state.after)):
        if judged is not None:
            print(f'{name}: {improvement_page.described(judged)}')
    print(f'wrote {options.output} and {page}')


def _tell(state: Improvement) -> None:
    if state.after is not None:
        return
    update = state.updates[-1]
    known = sorted(cost for cost in update.costs if cost is not None)
    text = (f'cost {known[0]:.3g} to {known[-1]:.3g}' if known else 'no roll-out came to its end')
    if update.ended:
        text += f'; {len(update.ended)} ended early: {update.ended[0]}'
    print(f'update {len(state.updates)}: {text}', flush=True)


def _skill(options: argparse.Namespace, task: Task) -> Skill:
    """:raises GdmpError: if there is no skill to improve, or it cannot be read"""
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.improvement.task import ProvidesSkill
    if options.skill is not None:
        return Skill.load(options.skill)
    if not isinstance(task, ProvidesSkill):
        raise ParameterError(f'{options.task}: the task brings no skill: give --skill')
    return task.skill()


def _variables(options: argparse.Namespace, task: Task) -> list[Variable]:
    """What varies: what is asked for, or what the task says, or the path."""
    from gdmp_ros.improvement.task import ProvidesSkill
    from gdmp_ros.improvement.variables import Stiffness, Tempo, ViaPoints, Weights
    for name, value in (('--weights', options.weights), ('--stiffness', options.stiffness)):
        if value is not None:
            check_number(name, value, 1)
    for place in options.via or ():
        check_number('--via', place, above=0.0, high=1.0)
    millimetres, turn = options.by
    # Tangents on S³ are half the rotation vector.
    pose = {'position': 1e-3 * millimetres, 'orientation': 0.5 * turn}
    chosen: list[Variable] = []
    if options.weights is not None:
        chosen.append(Weights(options.weights, pose))
    if options.stiffness is not None:
        chosen.append(Stiffness(options.stiffness))
    if options.via:
        chosen.append(ViaPoints(tuple(options.via), pose))
    if options.tempo:
        chosen.append(Tempo())
    if not chosen and isinstance(task, ProvidesSkill):
        chosen = list(task.variables())
    return chosen or [Weights(8, pose)]

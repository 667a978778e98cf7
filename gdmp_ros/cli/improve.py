"""Improve a skill by trying: roll-outs are scored, and the skill moves to the better ones.

TASK is `insertion` (a peg and a hole that is off by up to 3 mm, in simulation), a Python file with
a function score(trial) that returns the cost, or an executable that gets a file with the recorded
roll-out and prints the cost. A Python file may have arm(seed) too, which returns the simulated arm
with what is around it. A roll-out that would violate a limit is ended, and scores worst.

With --robot the roll-outs are made one by one on the robot of running nodes (gdmp up, or a
launch file). Before each the program says what is new, and waits for a person to say go. The arm
then goes back the way it came. Every roll-out is kept: the same command continues after an end.

While it runs, a page beside the skill shows costs and skills; open it in a browser.

examples:
  gdmp improve insertion -o inserts.json --jobs 2
  gdmp improve reach.py --skill skill.json -o better.json --vary-path 8 --vary-duration
  gdmp improve ./score --skill skill.json -o better.json --vary-via 0.3 0.6 \
      --vary-stiffness 1
  gdmp improve insertion -o inserts.json --resume rollouts.jsonl
  gdmp improve insertion -o inserts.json --backend dask 127.0.0.1:8786
  gdmp improve reach.py --skill skill.json -o better.json --robot --updates 3 --by 3 0.02

The search cma and pages come with: pip install '.[sim,improve,report]' in the folder of gdmp_ros
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from gdmp_ros.choices import SEARCHES, TASKS_TO_IMPROVE
from gdmp_ros.cli.arguments import (
    add_arm_node,
    add_output,
    add_parallel,
    check_output,
    integer,
    number,
)
from gdmp_ros.errors import ParameterError
from gdmp_ros.util.optional_imports import extra, optional_import, ROS

if TYPE_CHECKING:
    from collections.abc import Callable

    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.improvement.session import Effort, Execute, Improvement
    from gdmp_ros.improvement.task import SimulatedTask, Task
    from gdmp_ros.improvement.variables import Variable, Variables
    from gdmp_ros.util.parallel import Journal

#: What is tried: text, default in simulation, and on a robot.
EFFORTS = {
    'updates': ('updates of the search', 6, 5),
    'samples': ('skills that are tried in each update', 10, 8),
    'situations': ('roll-outs of each skill, each in another situation', 8, 1),
    'held_out': ('roll-outs before and after, in situations not used for learning', 20, 3)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('task', metavar='TASK', help=f'{", ".join(TASKS_TO_IMPROVE)}, a Python '
                        'file, or an executable')
    add_output(parser, 'SKILL', 'where the improved skill is written')
    parser.add_argument('--skill', type=Path, metavar='SKILL',
                        help='skill to improve; by default that of the task')
    parser.add_argument('--page', type=Path, metavar='HTML',
                        help='page about the improvement (default: beside the improved skill)')
    effort = parser.add_argument_group('how much is tried')
    for field, (text, usual, robot) in EFFORTS.items():
        effort.add_argument(f'--{field.replace("_", "-")}', type=integer(0), metavar='N',
                            help=f'{text} (default {usual}; {robot} with --robot)')
    effort.add_argument('--search', choices=SEARCHES, default=SEARCHES[0],
                        help='pibb: reward-weighted averaging with covariance adaptation; cma: '
                             'CMA-ES (default %(default)s)')
    effort.add_argument('--seed', type=integer(0), default=0, metavar='N',
                        help='the same one gives the same skill (default %(default)s)')
    effort.add_argument('--largest-force', type=number(above=0.0), default=100.0, metavar='N',
                        help='external force at which a roll-out is ended [N] '
                             '(default %(default)g)')
    vary = parser.add_argument_group('what varies (by default what the task says)')
    vary.add_argument('--vary-path', type=integer(1), metavar='N',
                      help='the path, by N bumps for each coordinate of the pose')
    vary.add_argument('--vary-via', type=number(above=0.0, high=1.0), nargs='+', metavar='S',
                      help='the pose at this progress, 0 to 1')
    vary.add_argument('--vary-spiral', type=integer(1), metavar='N',
                      help='a spiral of N turns around the path, across the z axis of the base: '
                           'searching for a hole')
    vary.add_argument('--vary-stiffness', type=integer(1), metavar='N',
                      help='the stiffness at N places; 1: the same factors everywhere')
    vary.add_argument('--vary-duration', action='store_true', help='the duration')
    vary.add_argument('--by', type=number(above=0.0), nargs=2, default=(5.0, 0.05),
                      metavar=('MM', 'RAD'),
                      help='first standard deviation of positions and rotations (default 5 0.05)')
    add_parallel(parser)
    nodes = parser.add_argument_group('on a robot')
    nodes.add_argument('--robot', action='store_true',
                       help='one by one on the robot of running nodes; a person says go')
    add_arm_node(parser)
    nodes.add_argument('--server', default='trajectory_server', metavar='NODE',
                       help='with its namespace (default %(default)s)')
    nodes.add_argument('--model', default='', metavar='MODEL',
                       help='of the arm: panda, fr3, or as for gdmp check (default: panda)')
    nodes.add_argument('--wait', type=number(0.0), default=120.0, metavar='S',
                       help='timeout for the nodes [s] (default %(default)g)')


def run(options: argparse.Namespace) -> None:
    """Improve, and write the skill and the page."""
    check_output(options.output, '.json')
    page = options.page or options.output.with_suffix('.html')
    check_output(page, '.html')
    insertion = options.task == TASKS_TO_IMPROVE[0]
    if options.robot:
        _check_robot(options, insertion)
    for name, (_, usual, robot) in EFFORTS.items():
        if getattr(options, name) is None:
            setattr(options, name, robot if options.robot else usual)
    with optional_import(extra('sim')):
        from gdmp_ros.improvement.insertion import Insertion
        from gdmp_ros.improvement.session import subject
        from gdmp_ros.improvement.task import task_from_file
        from gdmp_ros.improvement.variables import Variables
    from gdmp_ros.util.parallel import Journal
    task = (Insertion(largest_force=options.largest_force) if insertion
            else task_from_file(Path(options.task), options.largest_force))
    variables = Variables(_skill(options, task), _variables(options, task))
    effort = _effort(options)
    journal = options.resume or (options.output.with_suffix('.jsonl') if options.robot else None)

    def kept(task: Task) -> Journal:
        return Journal(journal, subject(task, variables, options.search, effort, options.seed))
    print(f'{task.name}: {variables.size} numbers vary, {effort.rollouts} roll-outs; see {page}'
          + (f'; kept in {journal}' if journal else ''), flush=True)
    if not options.robot:
        _improve(options, task, variables, _parallel(options, kept(task)), page)
        return
    _improve_on_robot(options, task, variables, kept, page)


def _improve(options: argparse.Namespace, task: Task, variables: Variables, execute: Execute,
             page: Path) -> None:
    """Improve, and write the skill and the page."""
    from gdmp_ros.improvement.session import improve
    with optional_import(extra('report')):
        from gdmp_ros.view import pages
    state: Improvement | None = None
    for state in improve(task, variables, execute, _effort(options), options.search, options.seed):
        pages.write_improvement(state, page, done=False)
        _tell(state)
    if state is None:
        return
    pages.write_improvement(state, page, done=True)
    state.skill().save(options.output)
    for name, judged in (('before', state.before), ('after', state.after)):
        if judged is not None:
            print(f'{name}: {pages.described(judged)}')
    if state.worse:
        print('the best guess does worse: the skill is kept as it was. Make more updates, or '
              'search with another --seed')
    print(f'wrote {options.output} and {page}')


def _effort(options: argparse.Namespace) -> Effort:
    from gdmp_ros.improvement.session import Effort
    return Effort(*(getattr(options, name) for name in EFFORTS))


def _parallel(options: argparse.Namespace, journal: Journal) -> Execute:
    """Roll-outs on several processes, or on a cluster."""
    from gdmp_ros.improvement.session import roll_out
    from gdmp_ros.util.parallel import map_tasks, scheduler_address
    dask = scheduler_address(options.backend)
    return lambda title, jobs: map_tasks(title, roll_out, jobs, options.jobs, dask, journal)


def _check_robot(options: argparse.Namespace, insertion: bool) -> None:
    """:raises ParameterError: if an option makes no sense with a robot"""
    if insertion:
        raise ParameterError('insertion is a simulation: with --robot give a Python file or an '
                             'executable that scores a roll-out')
    if options.jobs != 1 or options.backend:
        raise ParameterError('--robot makes one roll-out after the other: neither --jobs nor '
                             '--backend can be used')


def _improve_on_robot(options: argparse.Namespace, scored: SimulatedTask, variables: Variables,
                      kept: Callable[[Task], Journal], page: Path) -> None:
    """Roll-outs one by one on the robot of running nodes."""
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.trials_client import TrialsClient
    from gdmp_ros.improvement.one_by_one import OneByOne, Quit, RobotTask
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.path_check import Reach
    reach, start = Reach(Arm(options.model)), variables.skill.start[:7]
    robot = TrialsClient(options.server, options.node, options.largest_force)
    try:
        task = RobotTask(scored, robot)
        journal = kept(task)
        robot.begin_at(lambda present: reach.posture(start, present), options.wait)
        print('Each roll-out begins at the start of the skill. If the arm is elsewhere, its '
              'joints move there in a straight line of joint space. After a roll-out it goes '
              'back the way it came. Only obstacles in the scene of the arm are known.',
              flush=True)
        _improve(options, task, variables, OneByOne(robot, journal), page)
    except Quit as error:
        print(f'{error}; the same command continues')
    finally:
        robot.close()


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
    from gdmp_ros.improvement.variables import Spiral, Stiffness, Tempo, ViaPoints, Weights
    millimetres, turn = options.by
    # Tangents on S³ are half the rotation vector.
    pose = {'position': 1e-3 * millimetres, 'orientation': 0.5 * turn}
    chosen: list[Variable] = []
    if options.vary_path is not None:
        chosen.append(Weights(options.vary_path, pose))
    if options.vary_spiral is not None:
        chosen.append(Spiral(options.vary_spiral, pose['position']))
    if options.vary_stiffness is not None:
        chosen.append(Stiffness(options.vary_stiffness))
    if options.vary_via:
        chosen.append(ViaPoints(tuple(options.vary_via), pose))
    if options.vary_duration:
        chosen.append(Tempo())
    if not chosen and isinstance(task, ProvidesSkill):
        chosen = list(task.variables())
    return chosen or [Weights(8, pose)]

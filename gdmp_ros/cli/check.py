"""Check whether an arm can follow a skill: reach, joint limits, singularities, collisions.

The arm follows the path pose by pose; the first posture is searched from its home posture. Speeds,
dynamics and other objects are not checked. The exit code is 1 if it cannot follow the path.

examples:
  gdmp check skill.json
  gdmp check skill.json --goal-position 0.4 0.3 0.3 --plot check.png
  gdmp check insert.json --object hole 0.5 0.1 0.2 0.92 0 0 0.38
  gdmp check skill.json --model menagerie:franka_fr3
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gdmp_ros.cli.arguments import add_objects, add_scale, among_objects, check_output
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import table

if TYPE_CHECKING:
    from gdmp_ros.dmp.skill import Skill


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, metavar='SKILL')
    parser.add_argument('--goal-position', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='with the goal at another position [m]')
    add_objects(parser)
    add_scale(parser)
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='MJCF file, menagerie:NAME or robot_descriptions:NAME; the built-in '
                             'Panda by default')
    parser.add_argument('--plot', type=Path, metavar='PNG',
                        help='draw the path, where it cannot, and the margins')


def run(options: argparse.Namespace) -> int:
    """Check, print, draw."""
    check_output(options.plot, '.png', '.pdf', '.svg')
    from gdmp_ros.dmp.skill import Skill
    skill = among_objects(Skill.load(options.skill), options.objects, options.object_scale)
    with optional_import(extra('sim')):
        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.path_check import check_skill, PathChecker
    if options.goal_position is not None:
        skill = _with_goal_at(skill, options.goal_position)
    result, positions = check_skill(skill, PathChecker(Arm(options.model)))
    problems = result.problems()
    table(f'{options.skill} with {options.model or "the Panda"}', ['', 'least'], [
        [margin.label, f'{margin.values.min():.3f}'] for margin in result.margins])
    print(f'the tool moves at up to {result.speed.max():.2f} m/s and '
          f'{result.acceleration.max():.1f} m/s²')
    for problem in problems:
        print(problem)
    print('the arm cannot follow the whole path' if problems
          else 'the arm can follow the whole path')
    if options.plot:
        from gdmp_ros.view import plots, skill_plots
        plots.save(skill_plots.check_figure(result, positions), options.plot)
        print(f'wrote {options.plot}')
    return 1 if problems else 0


def _with_goal_at(skill: Skill, position: list[float]) -> Skill:
    """
    The skill with its goal at another position.

    :raises DataError: if it is one of the joints
    """
    from gdmp_ros.playback.settings import PlayerSettings
    from gdmp_ros.playback.streamed_skill import Kind, StreamedSkill
    if StreamedSkill(skill, PlayerSettings()).kind is Kind.JOINTS:
        raise DataError('the goal of a skill of the joints is a posture, not a position')
    goal = skill.goal.copy()
    goal[:3] = position
    return skill.between(goal=goal)

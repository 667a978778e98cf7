"""Check whether an arm can follow a skill: reach, joint limits, singularities, collisions.

The arm follows the path pose by pose; the first posture is searched from its home posture.
Dynamics are not checked. The exit code is 1 if it cannot follow the path. With --scene, what is
around the arm is known (docs/obstacles.md): where the tool would come too near, a way around is
searched, and checked.

examples:
  gdmp check skill.json
  gdmp check skill.json --goal-position 0.4 0.3 0.3 --plot check.png
  gdmp check insert.json --object hole 0.5 0.1 0.2 0.92 0 0 0.38
  gdmp check skill.json --model menagerie:franka_fr3
  gdmp check skill.json --scene scene.yaml --plot check.png
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
    from gdmp_ros.scene import Scene
    from gdmp_ros.sim.arm import Arm


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
    parser.add_argument('--scene', type=Path, metavar='YAML',
                        help='what is around the arm, in the frame of its base')
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
    arm, scene = Arm(options.model), None
    if options.scene:
        from gdmp_ros.scene import read_scene
        scene = read_scene(options.scene)
        skill = _led_around(skill, scene, arm)
    result, positions = check_skill(skill, PathChecker(arm, scene=scene))
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


def _led_around(skill: Skill, scene: Scene, arm: Arm) -> Skill:
    """The skill with a way around what is in the way of the tool, if there is one."""
    from gdmp_ros.learning.detour import BlockedError, detour, leads_around
    from gdmp_ros.sim.tool_shape import tool_of
    if not leads_around(skill):
        print('no way around is searched for such a skill: it is checked as it is')
        return skill
    try:
        found = detour(skill, scene, tool_of(arm))
    except BlockedError as error:
        print(f'{error}; the plain path is checked')
        return skill
    if found.around:
        print(f'{", ".join(found.around)} in the way of the tool: it goes around, '
              f'{found.longer:.2f} times as far, in {found.skill.duration:.2f} s instead of '
              f'{skill.duration:.2f}; that path is checked')
    return found.skill


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

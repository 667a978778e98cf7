"""Check whether an arm can follow a skill: reach, joint limits, singularities, collisions.

The arm follows the path pose by pose; the first posture is searched from its home posture. Speeds,
dynamics and other objects are not checked. The exit code is 1 if it cannot follow the path.

examples:
  gdmp check skill.json
  gdmp check skill.json --goal-position 0.4 0.3 0.3 --plot check.png
  gdmp check skill.json --model menagerie:franka_fr3
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gdmp_ros.cli.arguments import check_output
from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import table

if TYPE_CHECKING:
    import numpy as np

    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.sim.path_check import PathCheck, PathChecker

#: Poses of a path that are checked.
POSES = 200
#: The motion is checked for this many durations: a changed goal is reached after the first one.
SHOWN = 1.2


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('skill', type=Path, metavar='SKILL')
    parser.add_argument('--goal-position', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='with the goal at another position [m]')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='MJCF file, menagerie:NAME or robot_descriptions:NAME; the built-in '
                             'Panda by default')
    parser.add_argument('--plot', type=Path, metavar='PNG',
                        help='draw the path, where it cannot, and the margins')


def run(options: argparse.Namespace) -> int:
    """Check, print, draw."""
    check_output(options.plot, '.png', '.pdf', '.svg')
    import numpy as np

    from gdmp_ros.dmp.skill import Skill
    skill = Skill.load(options.skill)
    with optional_import(extra('sim')):
        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.path_check import PathChecker
    arm = Arm(options.model)
    times = np.linspace(0.0, SHOWN * skill.duration, POSES)
    found, positions = _checked(skill, PathChecker(arm), times, options.goal_position)
    problems = found.problems()
    table(f'{options.skill} with {options.model or "the Panda"}', ['', 'least'], [
        [one.label, f'{one.values.min():.3f}'] for one in found.margins])
    for problem in problems:
        print(problem)
    print('the arm cannot follow the whole path' if problems
          else 'the arm can follow the whole path')
    if options.plot:
        from gdmp_ros.view import plots, skill_plots
        plots.save(skill_plots.check_figure(found, positions), options.plot)
        print(f'wrote {options.plot}')
    return 1 if problems else 0


def _checked(skill: Skill, checker: PathChecker, times: np.ndarray, goal: list[float] | None
             ) -> tuple[PathCheck, np.ndarray]:
    """
    Check the motion of a skill of a pose or of the joints; returns the positions of the tool too.

    :raises DataError: if it is another skill, or a goal position is given for one of the joints
    """
    import numpy as np

    from gdmp_ros.playback.player_settings import PlayerSettings
    from gdmp_ros.playback.streamed import streamed
    of_joints = streamed(skill, PlayerSettings()).of_joints
    if goal is not None:
        if of_joints:
            raise DataError('the goal of a skill of the joints is a posture, not a position')
        moved = skill.goal.copy()
        moved[:3] = goal
        skill = skill.between(goal=moved)
    points = skill.rollout().sample(times).points.reshape(len(times), -1)
    if of_joints:
        found = checker.check_postures(times, points)
        return found, np.array([checker.position(posture) for posture in points])
    return checker.check(times, points[:, :7]), points[:, :3]

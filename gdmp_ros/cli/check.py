"""Check whether an arm can follow a skill: reach, joint limits, singularities, collisions.

The arm follows the path pose by pose from its home posture. Nothing is simulated: dynamics and
contact are not checked. The exit code is 1 if it cannot follow the path.

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
    from gdmp_ros.sim.arm import Arm

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
    parser.add_argument('--plot', type=Path, metavar='PNG', help='draw where it cannot')


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
    poses = _poses(skill, arm, times, options.goal_position)
    found = PathChecker(arm).check(times, poses)
    problems = found.problems()
    table(f'{options.skill} with {options.model or "the Panda"}', ['', 'least'], [
        [one.label, f'{one.values.min():.3f}'] for one in found.margins])
    for problem in problems:
        print(problem)
    print('the arm cannot follow the whole path' if problems
          else 'the arm can follow the whole path')
    if options.plot:
        from gdmp_ros.view import plots, skill_plots
        plots.save(skill_plots.check_figure(found, poses[:, :3]), options.plot)
        print(f'wrote {options.plot}')
    return 1 if problems else 0


def _poses(skill: Skill, arm: Arm, times: np.ndarray, goal: list[float] | None) -> np.ndarray:
    """
    Poses of the tool in the motion of a skill of a pose or of the joints.

    :raises DataError: if it is another skill, or a goal position is given for one of the joints
    """
    import numpy as np

    from gdmp_ros.playback.player_settings import PlayerSettings
    from gdmp_ros.playback.streamed import streamed
    tool = streamed(skill, PlayerSettings())
    if goal is not None:
        if tool.of_joints:
            raise DataError('the goal of a skill of the joints is a posture, not a position')
        moved = skill.goal.copy()
        moved[:3] = goal
        skill = skill.between(goal=moved)
    points = skill.rollout().sample(times).points.reshape(len(times), -1)
    return np.array([arm.pose_at(point) for point in points]) if tool.of_joints else points[:, :7]

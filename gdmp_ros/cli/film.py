"""Make a film of a recorded run, or of a skill that the simulated arm executes.

The path of the tool is drawn as a line of small spheres. Without a screen, EGL or OSMesa draws the
pictures (Debian: libegl1 or libosmesa6).

examples:
  gdmp film out/demo/run -o run.mp4
  gdmp film skill.json -o skill.webp --speed 2
  gdmp film skill.json -o fr3.mp4 --model menagerie:franka_fr3
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

from gdmp_ros.cli.arguments import add_robot, check_number
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.util.optional_imports import extra, optional_import

if TYPE_CHECKING:
    import numpy as np

SUFFIXES = ('.mp4', '.webp', '.gif')
#: Largest number of spheres along the path.
_SPHERES = 150


class _Motion(NamedTuple):
    """Times [s], joint positions [rad] and tool positions [m]."""

    times: np.ndarray
    joints: np.ndarray
    path: np.ndarray


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', type=Path, metavar='BAG_OR_SKILL',
                        help='bag with the state of an arm, or skill file')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILM',
                        help=f'{" or ".join(SUFFIXES)}; .png: the last picture')
    add_robot(parser)
    parser.add_argument('--speed', type=float, default=1.0, metavar='X',
                        help='factor of the playback speed (default %(default)g)')
    parser.add_argument('--fps', type=float, default=25.0, metavar='N',
                        help='pictures per second (default %(default)g)')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='another arm: MJCF file, menagerie:NAME, robot_descriptions:NAME')


def run(options: argparse.Namespace) -> None:
    """Choose the pictures and draw them."""
    check_number('--speed', options.speed, above=0.0, high=100.0)
    check_number('--fps', options.fps, above=0.0, high=120.0)
    if options.output.suffix not in (*SUFFIXES, '.png'):
        raise DataError(f'{options.output}: expected a name ending in {", ".join(SUFFIXES)} or '
                        '.png')
    if not options.output.absolute().parent.is_dir():
        raise DataError(f'{options.output.parent}: there is no such folder')
    import numpy as np
    with optional_import(extra('sim')):
        from gdmp_ros.view.films import render_to
        times, joints, path = _motion(options)
    frame_times = np.arange(times[0], times[-1], options.speed / options.fps)
    postures = joints[np.clip(np.searchsorted(times, frame_times), 0, len(times) - 1)]
    still = options.output.suffix == '.png'
    missing = render_to(options.output, postures[-1] if still else postures,
                        path[::max(1, len(path) // _SPHERES)], options.model, 1.0 / options.fps)
    if missing is not None:
        raise GdmpError(missing)
    print(f'wrote {options.output}: {1 if still else len(postures)} pictures')


def _motion(options: argparse.Namespace) -> _Motion:
    if options.source.is_dir() or options.source.suffix == '.mcap':
        return _recorded(options)
    return _executed(options)


def _recorded(options: argparse.Namespace) -> _Motion:
    from gdmp_ros.data import runs
    run = runs.read(options.source, options.robot)
    return _Motion(1e-9 * (run.state_stamps - run.state_stamps[0]), run.joints, run.poses[:, :3])


def _executed(options: argparse.Namespace) -> _Motion:
    import numpy as np

    from gdmp_ros.dmp.skill import Skill
    skill = Skill.load(options.source)
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.execution import execute
    arm = Arm(options.model)
    done = execute(skill, arm)
    return _Motion(arm.period * np.arange(len(done.joints)), done.joints, done.measured[:, :3])

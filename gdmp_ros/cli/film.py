"""Make a film of a recorded run, or of a skill that the simulated arm executes for it.

The path of the tool is drawn as beads. Without a screen the pictures are drawn by EGL or OSMesa
(Debian: libegl1 or libosmesa6).

examples:
  gdmp film out/demo/run -o run.mp4
  gdmp film skill.json -o skill.webp --speed 2
  gdmp film skill.json -o fr3.mp4 --model menagerie:franka_fr3
"""
from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from gdmp_ros.data import runs
from gdmp_ros.dmp import Skill
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.util.optional_imports import extra, optional_import

HELP = 'make a film of a run, or of a skill'
SUFFIXES = ('.mp4', '.webp')
#: Beads of the path, at most.
_BEADS = 150


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', type=Path, metavar='BAG_OR_SKILL',
                        help='bag with the state of an arm, or skill file')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='FILM',
                        help=f'{" or ".join(SUFFIXES)}; .png: the last picture')
    parser.add_argument('--robot', default='', metavar='NAME',
                        help='namespace, where a bag has several robots')
    parser.add_argument('--speed', type=float, default=1.0, metavar='X',
                        help='times faster than it was (default %(default)g)')
    parser.add_argument('--fps', type=float, default=25.0, metavar='N',
                        help='pictures per second (default %(default)g)')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='another arm: MJCF file, menagerie:NAME, robot_descriptions:NAME')


def run(options: argparse.Namespace) -> None:
    """Choose the pictures and draw them."""
    for name, value, most in (('--speed', options.speed, 100.0), ('--fps', options.fps, 120.0)):
        if not (math.isfinite(value) and 0.0 < value <= most):
            raise ParameterError(f'{name} is {value:g}, expected more than 0 and at most {most:g}')
    if options.output.suffix not in (*SUFFIXES, '.png'):
        raise DataError(f'{options.output}: expected a name ending in {", ".join(SUFFIXES)} or '
                        '.png')
    if not options.output.absolute().parent.is_dir():
        raise DataError(f'{options.output.parent}: there is no such folder')
    with optional_import(extra('sim')):
        from gdmp_ros.view.films import render_to
        times, joints, path = (_recorded(options) if options.source.is_dir()
                               or options.source.suffix == '.mcap' else _played(options))
    wanted = np.arange(times[0], times[-1], options.speed / options.fps)
    shown = joints[np.clip(np.searchsorted(times, wanted), 0, len(times) - 1)]
    still = options.output.suffix == '.png'
    missing = render_to(options.output, shown[-1] if still else shown,
                        path[::max(1, len(path) // _BEADS)], options.model, 1.0 / options.fps)
    if missing is not None:
        raise GdmpError(missing)
    print(f'wrote {options.output}: {1 if still else len(shown)} pictures')


def _recorded(options: argparse.Namespace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], joints [rad] and positions [m] of a run."""
    found = runs.read(options.source, options.robot)
    return (1e-9 * (found.state_stamps - found.state_stamps[0]), found.joints,
            found.poses[:, :3])


def _played(options: argparse.Namespace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], joints [rad] and positions [m] of a skill that an arm executes."""
    skill = Skill.load(options.source)
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.execution import execute
    arm = Arm(options.model)
    played = execute(skill, arm)
    return arm.period * np.arange(len(played.joints)), played.joints, played.measured[:, :3]

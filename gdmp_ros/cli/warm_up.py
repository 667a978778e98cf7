"""Compile the kernels now, so that nodes and verbs start without compiling.

Kernels are compiled when they are first used, which takes up to a minute, and kept in the folder
that GDMP_CACHE names (default: ~/.cache/gdmp_ros). Two processes share the work. Kernels of older
releases are removed.

example:
  gdmp warm-up
"""
from __future__ import annotations

import argparse
from collections.abc import Callable
import subprocess

from gdmp_ros.errors import GdmpError
from gdmp_ros.util import child_process
from gdmp_ros.util.optional_imports import extra, optional_import


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('part', nargs='?', choices=sorted(PARTS),
                        help='compile only this part; both by default')


def run(options: argparse.Namespace) -> None:
    """Compile; the largest part here, the other one in another process meanwhile."""
    if options.part:
        PARTS[options.part]()
        return
    from gdmp_ros.kernels import cache_folder, remove_stale
    remove_stale()
    other = subprocess.Popen(child_process.command('gdmp_ros.cli.start', 'warm-up', 'control'))
    try:
        compile_motion()
        code = other.wait()
    finally:
        other.kill()
        other.wait()
    if code != 0:
        raise GdmpError(f'the kernels of the controller could not be compiled (exit code {code})')
    print(f'the kernels are compiled: {cache_folder()}')


def compile_motion() -> None:
    """Use the kernels of learning, roll-out, batch and player."""
    import numpy as np

    from gdmp_ros.data.gallery import learned
    from gdmp_ros.dmp.rollout import Batch, Rollout
    from gdmp_ros.playback.player import Player
    from gdmp_ros.playback.player_settings import PlayerSettings
    from gdmp_ros.playback.prediction import prediction
    skill = learned('polish')
    rollout = Rollout(skill)
    rollout.advance(0.01)
    rollout.retarget(skill.goal)
    rollout.sample(np.array([0.02, 0.03]))
    Batch([rollout, Rollout(skill)]).advance(0.01)
    prediction(rollout, 2)
    player = Player(skill, PlayerSettings())
    player.start(skill.start[:7])
    player.tick(0.001)


def compile_control() -> None:
    """Use the kernels of the controller."""
    with optional_import(extra('sim')):
        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.closed_loop import ClosedLoop
    arm = Arm()
    ClosedLoop(arm).warm_up(arm.measure(), arm.period)


#: Parts of the work, of similar duration.
PARTS: dict[str, Callable[[], None]] = {'motion': compile_motion, 'control': compile_control}

"""Check this machine for streaming at 1 kHz, and say what to change; or compile the kernels.

Checks Python, kernel, cores, clock, permission for SCHED_FIFO, ROS, DDS, buffers, disk and
compiled kernels, and measures a loop that only sleeps. Exit code 1 if a finding is bad.

With --compile, nothing is checked: the kernels are compiled now, so that nodes and verbs start
without compiling. Otherwise that happens when they are first used, which takes some minutes.
They are kept in the folder that GDMP_CACHE names (default: ~/.cache/gdmp_ros).

examples:
  gdmp doctor
  gdmp doctor --seconds 30
  gdmp doctor --json
  gdmp doctor --compile
  gdmp doctor --franka 172.16.0.2        # also the connection to a Franka, which does not move
"""
from __future__ import annotations

import argparse
from collections.abc import Callable
import importlib.util
import json
import subprocess

from gdmp_ros.cli.arguments import number
from gdmp_ros.errors import GdmpError
from gdmp_ros.util import child_process
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import table

#: Shortest time in which the cycles of a Franka are watched [s].
LEAST_FRANKA_S = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('--seconds', type=number(0.1, 3600.0), default=2.0, metavar='S',
                        help='duration of the measurement with a sleeping loop [s] '
                             '(default %(default)g)')
    parser.add_argument('--franka', metavar='HOST', help='check the connection to a Franka too')
    parser.add_argument('--json', action='store_true', help='print as JSON')
    parser.add_argument('--compile', nargs='?', const='all', choices=('all', *PARTS),
                        help='compile the kernels, or a part of them')


def run(options: argparse.Namespace) -> int:
    """Run all checks and print the findings; 1 if one is bad."""
    if options.compile:
        return _compile(options.compile)
    from gdmp_ros.realtime import doctor
    findings = doctor.examine(options.seconds)
    if options.franka:
        with optional_import(extra('franka')):
            from gdmp_ros.franka import doctor as franka_doctor
        findings += franka_doctor.examine(options.franka, max(options.seconds, LEAST_FRANKA_S))
    if options.json:
        print(json.dumps([finding._asdict() for finding in findings], indent=1))
    else:
        table('this machine', ['', 'verdict', 'found'],
              [[finding.subject, finding.level, finding.found] for finding in findings])
        for finding in findings:
            if finding.advice:
                print(f'{finding.subject}: {finding.advice}')
    return int(any(finding.level == doctor.BAD for finding in findings))


def _compile(part: str) -> int:
    """Compile; the largest part here, the other one in another process meanwhile."""
    if part != 'all':
        PARTS[part]()
        return 0
    from gdmp_ros.kernels import cache_folder, remove_stale
    remove_stale()
    other = subprocess.Popen(child_process.command('gdmp_ros.cli.start', 'doctor', '--compile',
                                                   'control'))
    try:
        compile_motion()
        code = other.wait()
    finally:
        other.kill()
        other.wait()
    if code != 0:
        raise GdmpError(f'the kernels of the controller could not be compiled (exit code {code})')
    print(f'the kernels are compiled: {cache_folder()}')
    return 0


def compile_motion() -> None:
    """Use the kernels of learning, roll-out, batch and player."""
    import numpy as np

    from gdmp_ros.data.gallery import learned
    from gdmp_ros.dmp.frames import seen_from
    from gdmp_ros.dmp.rollout import Batch, Rollout
    from gdmp_ros.manifolds.poses import IDENTITY
    from gdmp_ros.playback.player import Player
    from gdmp_ros.playback.prediction import prediction
    from gdmp_ros.playback.rehearsal import rehearse
    from gdmp_ros.playback.settings import PlayerSettings
    from gdmp_ros.scene.points import PointMap
    skill = learned('polish')
    rollout = Rollout(skill)
    rollout.advance(0.01)
    rollout.retarget(skill.goal)
    rollout.sample(np.array([0.02, 0.03]))
    Batch([rollout, Rollout(skill)]).advance(0.01)
    seen_from(skill.manifold, IDENTITY, skill.start[None])
    prediction(rollout, 2)
    player = Player(skill, PlayerSettings())
    player.start(skill.start[:7])
    player.tick(0.001)
    rehearse(skill, PlayerSettings())
    cloud = PointMap(0.2, 0.1)
    cloud.see(np.full((1, 3), 0.1), IDENTITY)
    cloud.volumes(1)


def compile_control() -> None:
    """Use the kernels of the controller."""
    import numpy as np

    from gdmp_ros.control.target import resting_target
    with optional_import(extra('sim')):
        from gdmp_ros.sim.arm import Arm
        from gdmp_ros.sim.closed_loop import ClosedLoop
    arm = Arm()
    loop = ClosedLoop(arm)
    loop.warm_up(arm.measure(), arm.period)
    loop.follow_all(np.array([resting_target(arm.measure().pose)] * 3))
    if importlib.util.find_spec('rclpy') is not None:
        from gdmp_ros.ros.arm import compiled_loop as of_arm
        from gdmp_ros.ros.server import compiled_loop as of_server
        of_arm.warm_up(loop, loop.driver)
        of_server.warm_up()
        if importlib.util.find_spec('pylibfranka') is not None:
            from gdmp_ros.franka.channel import Channel
            from gdmp_ros.franka.plain_cycle import Link
            from gdmp_ros.ros.arm import franka_loop as of_franka
            of_franka.warm_up(loop, Link(Channel().wire, arm.known.view))


#: Parts of the work, of similar duration.
PARTS: dict[str, Callable[[], None]] = {'motion': compile_motion, 'control': compile_control}

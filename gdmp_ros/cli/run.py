"""Run a skill, a sequence or a recorded run on running nodes, and switch the goal on the way.

Without a file, the skill that the trajectory server has loaded is executed; a skill or a sequence
is loaded first. Ctrl-C brings the motion to a smooth stop.

Of a recorded run the references are sent to the arm again, in the recorded rhythm, with new
stamps. The arm keeps its rule: it follows only if the motion begins near the robot. Bring it there
first (gdmp home, ~/reset_world, or hand guiding), or call the service ~/arm of the arm: it then
moves to the beginning with 0.25 m/s. The trajectory server must not publish meanwhile.

examples:
  gdmp run
  gdmp run --goal-position 0.5 -0.1 0.4 --switch-at 1.5
  gdmp run skill.json --tempo 0.5 --server left/trajectory_server
  gdmp run wipe.json --cycles 5
  gdmp run skill.json --context height=0.03
  gdmp run insert.json --object hole 0.5 0.1 0.2 0.92 0 0 0.38
  gdmp run sequence.yaml --first-step 2
  gdmp run out/demo/run --node franka_arm
"""
from __future__ import annotations

import argparse
import os
from pathlib import Path

from gdmp_ros.choices import SEQUENCES
from gdmp_ros.cli.arguments import (
    add_arm_node,
    add_context,
    add_objects,
    integer,
    number,
    poses_of_objects,
)
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.util.optional_imports import optional_import, ROS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', type=Path, nargs='?', metavar='SKILL|SEQUENCE|BAG',
                        help='default: the skill that the server has loaded')
    parser.add_argument('--server', default='trajectory_server', metavar='NODE',
                        help='with its namespace (default %(default)s)')
    parser.add_argument('--wait', type=number(0.0), default=120.0, metavar='S',
                        help='timeout for the nodes [s] (default %(default)g)')
    skill = parser.add_argument_group('skills and sequences')
    skill.add_argument('--goal-position', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                       help='switch the goal of the position to this [m]')
    skill.add_argument('--switch-at', type=number(0.0), default=1.0, metavar='S',
                       help='time of the goal switch after the start [s] (default %(default)g)')
    skill.add_argument('--tempo', type=number(0.0, 2.0), metavar='X',
                       help='0 to 2; 1 is as demonstrated. It is kept for later motions')
    skill.add_argument('--cycles', type=number(0.0), default=0.0, metavar='N',
                       help='of a rhythmic skill, which then ends at the centre of its cycle '
                            '(default: until its amplitude is set to 0, or Ctrl-C)')
    skill.add_argument('--first-step', type=integer(1), default=1, metavar='N',
                       help='begin with this step of the sequence (default %(default)s)')
    add_context(parser)
    add_objects(parser)
    recorded = parser.add_argument_group('recorded runs')
    recorded.add_argument('--topic', default='', metavar='TOPIC',
                          help='of the references in the bag (default: the only one)')
    recorded.add_argument('--to', default='', metavar='TOPIC',
                          help='on which they are sent (default: as recorded)')
    add_arm_node(parser)


def run(options: argparse.Namespace) -> int:
    """Run; 0 if the goal was reached."""
    source = options.source
    if source is not None and not source.exists():
        raise DataError(f'{source}: no such skill, sequence or bag')
    if source is not None and (source.is_dir() or source.suffix == '.mcap'):
        return _replay(options)
    is_sequence = source is not None and source.suffix in SEQUENCES
    if options.objects and is_sequence:
        raise ParameterError('--object: for a skill; the server looks the objects of a sequence '
                             'up itself')
    return _execute(source, is_sequence, options)


def _execute(source: Path | None, is_sequence: bool, options: argparse.Namespace) -> int:
    file = '' if source is None else str(source.absolute())
    from gdmp_ros.util.dds_network import default_environment
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.execute_client import execute, ExecuteRequest
    return execute(ExecuteRequest(
        options.server, '' if is_sequence else file, options.goal_position, options.switch_at,
        options.tempo, options.wait, options.cycles, file if is_sequence else '',
        options.first_step, options.context,
        poses_of_objects(options.objects)))


def _replay(options: argparse.Namespace) -> int:
    """Send the references of a recorded run again."""
    from gdmp_ros.data.runs import read_references
    from gdmp_ros.util.dds_network import default_environment
    references = read_references(options.source, options.topic)
    os.environ.update(default_environment())
    with optional_import(ROS):
        from gdmp_ros.ros.clients.replay import replay, ReplayRequest
    replay(references, ReplayRequest(options.to or references.topic, options.node, options.wait))
    print(f'replayed {len(references.times)} references in {references.times[-1]:.1f} s')
    return 0

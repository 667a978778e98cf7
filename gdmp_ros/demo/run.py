"""The demonstration, from recorded bags to a report."""
from __future__ import annotations

from pathlib import Path
import shutil
import time
from typing import Any, cast

from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import psutil

from gdmp_ros.data import lasa, recordings, runs
from gdmp_ros.data.bags import NS
from gdmp_ros.demo.report import draw, print_table, report, Switch, Timeline, window
from gdmp_ros.dmp.evaluation import reproduction_error
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.arm_client import move_joints, with_friction
from gdmp_ros.ros.clients.testbed import NodeTestbed, process_bed, SERVER
from gdmp_ros.util.files import write_json
from gdmp_ros.util.processes import interrupt_on_sigterm
from gdmp_ros.view.films import render_to

#: Goal switch at mid-motion: change of position and orientation, and new stiffness.
GOAL_STEP_M = np.array([0.03, -0.11, 0.04])
GOAL_ROTATION_RAD = np.array([0.25, 0.2, 0.3])
GOAL_STIFFNESS = np.diag([300.0, 700.0, 350.0])
#: Recorded before the motion begins and after it has finished [s].
LEAD_S, TAIL_S = 0.5, 1.0
#: Duration of the measurement of a bare loop that is not beside the motion [s].
BARE_S = 3.0


def run_demo(folder: Path, name: str, arm: ArmChoice) -> int:
    """
    Run everything.

    :param name: LASA class
    :returns: exit code
    :raises GdmpError: if a process ended early or something did not happen in time
    """
    interrupt_on_sigterm()
    arm.check()
    _clear(folder)
    print(f'demonstrations: LASA {name}, recorded as rosbag2', flush=True)
    bags = _record(folder, name, arm.frame)
    recording = recordings.read(bags[0])
    skill = Skill.learn(recording.demonstration)
    error = float(reproduction_error(skill, recording.demonstration)[0])
    skill.save(folder / 'skill.json')
    switch = _switch(skill)
    arm = with_friction(arm, folder)
    with arm.robot(folder / 'logs'), process_bed(NodeTestbed, folder, arm=arm) as bed:
        timeline = _stream(bed, bags[0], switch)
        print('reading the recorded bag', flush=True)
        run = bed.recorded()
    document = report(folder, run, timeline, switch, arm)
    document['learning'] = {'mean_relative_error': error, 'demonstration': bags[0].name}
    write_json(folder / 'report.json', document)
    print('drawing', flush=True)
    _draw(folder, run, timeline, document, arm.model)
    print_table(document)
    print(f'report, pictures and bag: {folder}')
    print(f'look at the run in a browser: gdmp studio {folder / "run"}')
    return 0


def _clear(folder: Path) -> None:
    """Remove the results of an earlier run, and nothing else."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ('demonstrations', 'run', 'logs'):
        shutil.rmtree(folder / name, ignore_errors=True)
    for path in [*folder.glob('.run.*.partial'), *folder.glob('*.png'), *folder.glob('*.npy'),
                 folder / 'report.json', folder / 'skill.json']:
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _record(folder: Path, name: str, frame: str) -> list[Path]:
    demos = lasa.robot_demonstrations(name)
    bags = [folder / 'demonstrations' / f'{name}_{i + 1}' for i in range(len(demos))]
    for i, (bag, demonstration) in enumerate(zip(bags, demos)):
        recordings.write(bag, demonstration, frame, recordings.EPOCH_NS + i * 60 * NS)
    return bags


def _switch(skill: Skill) -> Switch:
    manifold = cast(Product, skill.manifold)
    position, orientation, stiffness = manifold.split(skill.goal)
    rotated = UnitQuaternion().exp(orientation, 0.5 * GOAL_ROTATION_RAD)
    return Switch(np.concatenate([position + GOAL_STEP_M, rotated]), GOAL_STIFFNESS,
                  float(np.linalg.norm(GOAL_STEP_M)), float(np.linalg.norm(GOAL_ROTATION_RAD)),
                  SymmetricPositiveDefinite(3).distance(stiffness, GOAL_STIFFNESS))


def _stream(bed: NodeTestbed, bag: Path, switch: Switch) -> Timeline:
    """Start all processes, execute the skill and switch its goal."""
    print('starting arm, server and recorder', flush=True)
    if bed.arm.kind == 'franka':
        bed.start_arm(lateness_file=str(bed.folder / 'sim.npy'))
        print('moving to the home posture', flush=True)
        move_joints(bed.client, bed.arm.node)
    bed.start(arm={'lateness_file': str(bed.folder / 'sim.npy')},
              server={'demonstrations': [str(bag)],
                      'lateness_file': str(bed.folder / 'server.npy')})
    bed.children.start('bare', 'gdmp_ros.realtime.bare_loop', [str(bed.folder / 'bare.npy')])
    for name in ('subscribe', 'publish'):
        bed.children.start(f'bare_{name}', 'gdmp_ros.ros.bare_publisher', [name])
    bed.wait_log('bare_publish', 'publishing', 30.0)
    bed.spend(1.0)
    bare = {}
    if bed.arm.kind == 'franka':
        # Not beside the motion of a robot, which needs the cores.
        used = _cpu_seconds(bed)
        bed.spend(BARE_S)
        bare = {'bare': (_cpu_seconds(bed)['bare'] - used['bare']) / BARE_S}
        for name in ('bare', 'bare_publish', 'bare_subscribe'):
            bed.children.stop(name)
    timeline = _execute(bed, switch)
    timeline.cpu.update(bare)
    for name in ('bare', SERVER, bed.arm.node):  # they write their lateness at the end
        if name in bed.children.processes:
            bed.children.stop(name)
    return timeline


def _execute(bed: NodeTestbed, switch: Switch) -> Timeline:
    diagnosed: list[dict[str, str]] = []
    bed.client.subscribe(DiagnosticArray, '/diagnostics', lambda message: (
        diagnosed.extend({value.key: value.value for value in status.values}
                         for status in message.status if bed.arm.node in status.name)), 50)
    begun, used = time.monotonic_ns(), _cpu_seconds(bed)
    bed.spend(LEAD_S)
    print('executing the skill', flush=True)
    bed.client.execute()
    bed.wait_progress(0.5)
    print('switching the goal of pose and stiffness', flush=True)
    switched = time.time_ns()
    bed.client.goal_pose(switch.pose, bed.arm.frame)
    bed.client.goal_stiffness(switch.stiffness)
    result = bed.client.result(60.0)
    finished = time.time_ns()
    if result.error_code != result.SUCCESSFUL:
        hint = ('; without --friction its dry friction holds it: gdmp arm friction'
                if bed.arm.kind == 'franka' and not bed.arm.parameter_files else '')
        raise GdmpError(f'the motion ended with {result.error_code}: {result.error_string}{hint}')
    bed.spend(TAIL_S)
    ended, used_then = time.monotonic_ns(), _cpu_seconds(bed)
    seconds = (ended - begun) * 1e-9
    return Timeline(switched, finished, (begun, ended), bed.state.scheduler,
                    {name: (used_then[name] - used[name]) / seconds for name in used}, diagnosed)


def _cpu_seconds(bed: NodeTestbed) -> dict[str, float]:
    processes = {'server': SERVER, 'sim': bed.arm.node, 'bare': 'bare_publish'}
    return {name: sum(psutil.Process(bed.children.processes[process].pid).cpu_times()[:2])
            for name, process in processes.items() if process in bed.children.processes}


def _draw(folder: Path, run: runs.Run, timeline: Timeline, document: dict[str, Any],
          model: str) -> None:
    lateness = {'trajectory_server': window(folder, 'server', timeline)[:, 1] * 1e-3,
                document['arm']: window(folder, 'sim', timeline)[:, 1] * 1e-3,
                'bare sleeping loop': window(folder, 'bare', timeline)[:, 1] * 1e-3}
    draw(run, folder, document['goal_switch']['at_s'], timeline.finished, lateness)
    missing = render_to(folder / 'arm.png', run.joints[-1], run.poses[::100, :3], model)
    if missing:
        print(missing)

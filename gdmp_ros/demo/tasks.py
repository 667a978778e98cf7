"""Tasks that are shown to the simulated arm by hand, learned, and executed: picking, joints."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
import shutil
from typing import Any

from gdmp_msgs.msg import GripperState
import numpy as np
from tf2_msgs.msg import TFMessage

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.data import lasa
from gdmp_ros.data.skill_from_bags import LearningSettings, skill_from_bags
from gdmp_ros.data.tool import tool_manifold
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm_choice import ArmChoice
from gdmp_ros.ros.clients.client import START_UP_S
from gdmp_ros.ros.clients.joints_client import move_joints
from gdmp_ros.ros.clients.teacher import Teacher
from gdmp_ros.ros.clients.testbed import MODULES, NodeTestbed, Opener, process_bed, TAKE_RECORDER
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.scenes import CUBE_EDGE, PICK, PLACE
from gdmp_ros.util.atomic_write import write_json
from gdmp_ros.util.profiles import smoothstep
from gdmp_ros.util.signals import interrupt_on_sigterm
from gdmp_ros.util.terminal import table

FRAME = 'panda_link0'
#: Where the tool goes and how long it takes [m, s]; None: it rests.
WAY = [((*PICK.centre, 0.2), 1.6), ((*PICK.centre, 0.035), 1.6), (None, 1.2),
       ((*PICK.centre, 0.25), 1.2), ((*PLACE.centre, 0.25), 2.0), ((*PLACE.centre, 0.06), 1.2)]
CLOSE, OPEN = GripperCommand(0.0, 20.0), GripperCommand(0.08)
#: Displacement of the goal of the skill of the joints in mid-motion [m].
GOAL_STEP_M = np.array([0.03, -0.08, 0.05])


def picking_motion() -> tuple[Demonstration, float]:
    """Motion of the tool from a box to another one, and when the fingers are to close [s]."""
    home = Arm().pose_at(Arm().home)
    times, points, at, now = [], [], home[:3], 0.0
    for goal, seconds in WAY:
        end = at if goal is None else np.array(goal)
        for t in np.arange(0.0, seconds, 0.01):
            times.append(now + t)
            points.append([*(at + smoothstep(t / seconds) * (end - at)), *home[3:]])
        at, now = end, now + seconds
    times.append(now)
    points.append([*at, *home[3:]])
    return (Demonstration(np.array(times), np.array(points), tool_manifold(None)),
            sum(seconds for _, seconds in WAY[:2]) + 0.1)


def run_task(task: str, folder: Path, arm: ArmChoice, testbed: Opener = process_bed) -> int:
    """
    Show a task to the simulated arm by hand, learn it, and let an arm execute it.

    :param task: ``pick`` or ``joints``
    :param testbed: see `gdmp_ros.ros.clients.testbed.process_bed`
    :returns: exit code: 0 if it succeeded
    :raises GdmpError: if something does not happen in time
    """
    interrupt_on_sigterm()
    arm.check()
    folder.mkdir(parents=True, exist_ok=True)
    for name in ('takes', 'logs', 'run'):
        shutil.rmtree(folder / name, ignore_errors=True)
    print('a hand shows the task to the simulated arm', flush=True)
    with testbed(NodeTestbed, folder) as bed:
        _teach(bed, task)
    print('learning', flush=True)
    learned = skill_from_bags(sorted((folder / 'takes').glob('take_*')), LearningSettings(
        frame=FRAME, stiffness='none', joint_topic='' if task == 'joints' else None))
    skill = learned.skill
    if arm.kind == 'franka':  # the same joints in the same order, with other names
        skill = replace(skill, provenance={
            name: value for name, value in skill.provenance.items() if name != 'joints'})
    skill.save(folder / 'skill.json')
    with (arm.robot(folder / 'logs', gripper=task == 'pick'),
          testbed(NodeTestbed, folder, arm=arm) as bed):
        document = {'pick': _pick, 'joints': _follow_joints}[task](bed)
    document['task'], document['arm'] = task, arm.node
    write_json(folder / 'report.json', document)
    table('measured', ['', 'value'], [[name, value] for name, value in document.items()])
    return 0 if document['succeeded'] else 1


def _teach(bed: NodeTestbed, task: str) -> None:
    """Guide the simulated arm, and record a take."""
    bed.start_arm(**({'scene': 'pick_and_place'} if task == 'pick' else {}))
    bed.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(bed.folder / 'takes'),
        'also': ['/joint_states=sensor_msgs/msg/JointState'] if task == 'joints' else ['']})
    teacher = Teacher(FRAME, check=bed.check)
    try:
        teacher.ready()
        if task == 'joints':
            print(teacher.take(lasa.robot_demonstrations('GShape')[0]), flush=True)
            return
        shown, closes = picking_motion()
        teacher.command_gripper(OPEN)
        print(teacher.take(shown, [(closes, CLOSE), (shown.duration, OPEN)]), flush=True)
    finally:
        teacher.close()


def _start(bed: NodeTestbed, arm: dict[str, Any]) -> None:
    """Start arm and server with the skill; a Franka goes to its home posture first."""
    print('starting arm and server', flush=True)
    bed.start_arm(**arm)
    if bed.arm.kind == 'franka':
        move_joints(bed.client, bed.arm.node)
    bed.start_server(skill=str(bed.folder / 'skill.json'))
    bed.wait_holding()


def _pick(bed: NodeTestbed) -> dict[str, Any]:
    grippers: list[GripperState] = []
    cubes: list[np.ndarray] = []
    bed.client.subscribe(GripperState, 'gripper/state', grippers.append, 100)
    bed.client.subscribe(TFMessage, '/tf', lambda message: cubes.extend(
        messages.transform_numbers(one.transform) for one in message.transforms
        if one.child_frame_id == 'cube'), 100)
    if bed.arm.kind == 'franka':
        bed.children.start_node('franka_gripper', 'gdmp_ros.ros.arm.franka_gripper',
                                {'host': bed.arm.parameters()['host']})
    _start(bed, {'scene': 'pick_and_place'} if bed.arm.kind == 'sim' else {})
    bed.wait('the gripper', lambda: bool(grippers), START_UP_S)
    error = _execute(bed, lambda: None)
    bed.spend(0.5)
    held = [one.width for one in grippers if one.holding]
    document: dict[str, Any] = {
        'error': error, 'held_width_m': float(np.median(held)) if held else 0.0,
        'width_at_the_end_m': grippers[-1].width}
    placed = True
    if cubes:  # the robot behind a server of the protocol has a virtual object only
        away = np.abs(cubes[-1][:2] - PLACE.centre)
        placed = bool((away < PLACE.half).all())
        document['cube_from_the_middle_of_its_box_m'] = float(np.linalg.norm(away))
    document['succeeded'] = bool(not error and placed and held and abs(
        document['held_width_m'] - CUBE_EDGE) < 0.003)
    return document


def _follow_joints(bed: NodeTestbed) -> dict[str, Any]:
    _start(bed, {})
    bed.record()
    goal = np.zeros(7)

    def switch() -> None:
        goal[:] = messages.pose_numbers(bed.state.goal[0])
        goal[:3] += GOAL_STEP_M
        bed.client.goal_pose(goal, FRAME)
    error = _execute(bed, switch)
    bed.spend(0.5)
    run = bed.recorded()
    followed = run.joint_references
    known = np.isfinite(followed).all(axis=1)
    lag = followed[known] - run.joints[known]
    away = float(np.linalg.norm(run.poses[-1, :3] - goal[:3]))
    return {'error': error, 'joint_rmse_rad': float(np.sqrt(np.mean(lag ** 2))),
            'joint_max_rad': float(np.abs(lag).max()), 'goal_switched_by_m': float(
                np.linalg.norm(GOAL_STEP_M)), 'final_position_error_m': away,
            'succeeded': not error and away < 0.02}


def _execute(bed: NodeTestbed, half_way: Callable[[], None]) -> str:
    """Execute the skill; why it failed, or nothing."""
    print('executing the skill', flush=True)
    bed.client.execute()
    bed.wait_progress(0.5)
    half_way()
    result = bed.client.result(120.0)
    return '' if result.error_code == result.SUCCESSFUL else str(result.error_string)

"""Tasks that are shown to the simulated arm by hand, learned, and executed."""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
import shutil
from typing import Any

from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import GripperState
import numpy as np
from tf2_msgs.msg import TFMessage

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.control.target import resting_target, WRENCH, WRENCH_GAIN
from gdmp_ros.data import bags, lasa, recordings
from gdmp_ros.data.runs import limit_figures, Run
from gdmp_ros.data.skills import LearningSettings, skill_from_bags
from gdmp_ros.demo import clutter
from gdmp_ros.demo.objects import Camera, follow_objects, home_pose, motion, PLACES
from gdmp_ros.demo.recorded import GRIPPER, surroundings, TRANSFORMS
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.ros import messages
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA_GRIPPER
from gdmp_ros.ros.clients.arm_client import move_joints, with_friction
from gdmp_ros.ros.clients.server_client import START_UP_S
from gdmp_ros.ros.clients.teaching import Teacher
from gdmp_ros.ros.clients.testbed import (
    ARM,
    MODULES,
    NodeTestbed,
    Opener,
    process_bed,
    TAKE_RECORDER,
)
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.scenes import cloth_table, CUBE_EDGE, PICK, PLACE
from gdmp_ros.util.files import write_json
from gdmp_ros.util.processes import interrupt_on_sigterm
from gdmp_ros.util.profiles import smoothstep
from gdmp_ros.util.terminal import table

#: Where the tool goes and how long it takes [m, s]; None: it rests.
WAY = [((*PICK.centre, 0.2), 1.6), ((*PICK.centre, 0.035), 1.6), (None, 1.2),
       ((*PICK.centre, 0.25), 1.2), ((*PLACE.centre, 0.25), 2.0), ((*PLACE.centre, 0.06), 1.2)]
CLOSE, OPEN = GripperCommand(0.0, 20.0), GripperCommand(0.08)
#: Displacement of the goal of the skill of the joints in mid-motion [m].
GOAL_STEP_M = np.array([0.03, -0.08, 0.05])
WRENCH_TOPIC = '/ft/wrench'
#: Force [N], period [s] and radius [m] of the wiping that is shown, and how many cycles.
FORCE, PERIOD, RADIUS, SHOWN = 12.0, 2.5, 0.05, 5
#: Table below the tool [m], and the way down to it and up [s].
BELOW, WAY_S = 0.03, 1.5
#: How much higher the tables are on which it is executed [m].
HEIGHTS = (-0.02, 0.0, 0.02)
#: Cycles that are executed; the first one is the entry and does not count.
CYCLES = 4
#: Largest distance of the tool from the reference at the end [m, rad]: the height of a table is
#: not known, and the dry friction of two joints of a wrist (1.1 Nm each, on a Franka) may hold
#: against the springs (30 Nm/rad).
TABLE_TOLERANCE = (0.04, 0.08)
#: Rate at which the measured force is corrected [1/s].
GAIN = 5.0
#: Standard deviation of the noise of the sensors [m, N].
POSITION_NOISE, FORCE_NOISE = 1e-4, 0.3
#: Largest change of a joint torque in a tick [Nm].
TORQUE_RATE = 1.0
#: Ticks of the demonstration between two samples.
SAMPLE_EVERY = 5


def picking_motion(home: np.ndarray) -> tuple[Demonstration, float]:
    """
    Motion of the tool from a box to another one, and when the fingers are to close [s].

    :param home: where it begins (x, y, z, qw, qx, qy, qz)
    """
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
    Show a task to a simulated arm by hand, learn it, and let an arm execute it.

    :param task: ``pick``, ``joints``, ``objects``, ``clutter`` or ``wipe`` (`run_wiping`)
    :param testbed: see `gdmp_ros.ros.clients.testbed.process_bed`
    :returns: exit code: 0 if it succeeded
    :raises GdmpError: if something does not happen in time
    """
    if task == 'wipe':
        return run_wiping(folder, arm, testbed)
    interrupt_on_sigterm()
    arm.check()
    folder.mkdir(parents=True, exist_ok=True)
    for name in ('takes', 'logs', 'run'):
        shutil.rmtree(folder / name, ignore_errors=True)
    print('a hand shows the task to the simulated arm', flush=True)
    with testbed(NodeTestbed, folder) as bed:
        _teach(bed, task, arm)
    print('learning', flush=True)
    learned = skill_from_bags(sorted((folder / 'takes').glob('take_*')), LearningSettings(
        frame=arm.frame, stiffness='none', joint_topic='' if task == 'joints' else None,
        objects=('box', 'hole') if task == 'objects' else ()))
    skill = learned.skill
    if arm.kind == 'franka':  # the same joints in the same order, with other names
        skill = replace(skill, provenance={
            name: value for name, value in skill.provenance.items() if name != 'joints'})
    skill.save(folder / 'skill.json')
    arm = with_friction(arm, folder)
    with (arm.robot(folder / 'logs', gripper=task in ('pick', 'clutter')),
          testbed(NodeTestbed, folder, arm=arm) as bed):
        document = {'pick': _pick, 'joints': _follow_joints, 'objects': _among_objects,
                    'clutter': _among_clutter}[task](bed)
    document['task'], document['arm'] = task, arm.node
    write_json(folder / 'report.json', document)
    for place in document.get('places', ()):
        table('', ['at a place', 'value'], [[name, value] for name, value in place.items()])
    table('measured', ['', 'value'], [[name, value] for name, value in document.items()
                                      if name != 'places'])
    return 0 if document['succeeded'] else 1


def _teach(bed: NodeTestbed, task: str, arm: ArmChoice) -> None:
    """Guide a simulated arm like the one that is to execute it, and record a take."""
    # What is in the way comes later.
    bed.start_arm(world=_world('pick' if task == 'clutter' else task), **arm.shown_on)
    bed.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(bed.folder / 'takes'),
        'also': (['/joint_states=sensor_msgs/msg/JointState'] if task == 'joints' else
                 [f'/{ARM}/state=gdmp_msgs/msg/RobotState', TRANSFORMS, GRIPPER]
                 if task == 'clutter' else ['']),
        'transforms': task == 'objects'})
    teacher, home = Teacher(arm.frame, check=bed.check), home_pose(arm.model)
    try:
        teacher.ready()
        if task == 'joints':
            print(teacher.take(lasa.robot_demonstrations('GShape')[0]), flush=True)
            return
        if task == 'objects':
            camera = Camera(bed.client, arm, PLACES[0].at)
            try:
                print(teacher.take(motion(home)), flush=True)
            finally:
                camera.end()
            return
        demo, closes = picking_motion(home)
        teacher.command_gripper(OPEN)
        print(teacher.take(demo, [(closes, CLOSE), (demo.duration, OPEN)]), flush=True)
    finally:
        teacher.close()


def _world(task: str) -> dict[str, Any]:
    """What simulates an arm for a task, as parameters."""
    scenes = {'pick': 'pick_and_place', 'clutter': 'clutter'}
    return {'scene': scenes[task]} if task in scenes else {}


def _among_objects(bed: NodeTestbed) -> dict[str, Any]:
    _start(bed, 'objects', moving_objects=['hole'])
    # The camera does not repeat what is lost.
    bed.record(arguments=[TRANSFORMS, '--best-effort', '/tf'])

    def home() -> None:
        move_joints(bed.client, bed.arm.node)
        bed.wait_holding()
    document = follow_objects(bed, home)
    bed.end_recording()
    return document


def _start_arm(bed: NodeTestbed, world: dict[str, Any], **parameters: Any) -> None:
    """Start the arm; a Franka goes to its home posture."""
    bed.start_arm(world=world, **parameters)
    if bed.arm.kind == 'franka':
        move_joints(bed.client, bed.arm.node)


def _start(bed: NodeTestbed, task: str, **server: Any) -> None:
    """Start arm and server with the skill."""
    print('starting arm and server', flush=True)
    _start_arm(bed, _world(task), **(clutter.MARGIN if task == 'clutter' else {}))
    bed.start_server(skill=str(bed.folder / 'skill.json'), **server)
    bed.wait_holding()


def _among_clutter(bed: NodeTestbed) -> dict[str, Any]:
    return clutter.execute(bed, lambda among: _pick(
        bed, 'clutter', lambda: bed.record(arguments=[
            TRANSFORMS, GRIPPER, *surroundings(bed.arm.node)]), among.push))


def _pick(bed: NodeTestbed, task: str = 'pick', begin: Callable[[], None] = lambda: None,
          half_way: Callable[[], None] = lambda: None) -> dict[str, Any]:
    grippers: list[GripperState] = []
    cubes: list[np.ndarray] = []
    bed.client.subscribe(GripperState, 'gripper/state', grippers.append, 100)
    bed.client.subscribe(TFMessage, '/tf', lambda message: cubes.extend(
        messages.transform_numbers(transform.transform) for transform in message.transforms
        if transform.child_frame_id == 'cube'), 100)
    if bed.arm.kind == 'franka':
        bed.children.start_node(FRANKA_GRIPPER, MODULES[FRANKA_GRIPPER],
                                {'host': bed.arm.parameters()['host']})
    _start(bed, task, **({'stiffness': clutter.STIFFNESS, **clutter.MARGIN}
                         if task == 'clutter' else {}))
    bed.wait('the gripper', lambda: bool(grippers), START_UP_S)
    begin()
    error = _execute_task(bed, half_way, 0.5 if task == 'pick' else clutter.PUSH_AT)
    bed.spend(0.5)
    held = [gripper.width for gripper in grippers if gripper.holding]
    document: dict[str, Any] = {
        'error': error, 'held_width_m': float(np.median(held)) if held else 0.0,
        'width_at_the_end_m': grippers[-1].width}
    placed = True
    if cubes:  # the robot behind a server of the protocol has a virtual object only
        distance = np.abs(cubes[-1][:2] - PLACE.centre)
        placed = bool((distance < PLACE.half).all())
        document['cube_from_the_middle_of_its_box_m'] = float(np.linalg.norm(distance))
    document['placed'] = placed
    document['succeeded'] = bool(not error and placed and held and abs(
        document['held_width_m'] - CUBE_EDGE) < 0.003)
    return document


def _follow_joints(bed: NodeTestbed) -> dict[str, Any]:
    _start(bed, 'joints')
    bed.record()
    goal = np.zeros(7)

    def switch() -> None:
        goal[:] = messages.pose_numbers(bed.state.goal[0])
        goal[:3] += GOAL_STEP_M
        bed.client.goal_pose(goal, bed.arm.frame)
    error = _execute_task(bed, switch)
    bed.spend(0.5)
    run = bed.recorded()
    followed = run.joint_references
    known = np.isfinite(followed).all(axis=1)
    lag = followed[known] - run.joints[known]
    distance = float(np.linalg.norm(run.poses[-1, :3] - goal[:3]))
    return {'error': error, 'joint_rmse_rad': float(np.sqrt(np.mean(lag ** 2))),
            'joint_max_rad': float(np.abs(lag).max()), 'goal_switched_by_m': float(
                np.linalg.norm(GOAL_STEP_M)), 'final_position_error_m': distance,
            'succeeded': not error and distance < 0.02}


def _execute_task(bed: NodeTestbed, half_way: Callable[[], None], at: float = 0.5) -> str:
    """Execute the skill; why it failed, or nothing."""
    print('executing the skill', flush=True)
    bed.client.execute()
    bed.wait_progress(at)
    half_way()
    result = bed.client.result(120.0)
    return '' if result.error_code == result.SUCCESSFUL else str(result.error_string)


def record_wiping(bag: Path, arm: ArmChoice) -> None:
    """Show the wiping to a simulated arm: down, circles with a force, and up; with noise."""
    loop = ClosedLoop(Arm(cloth_table(BELOW, arm.model or 'panda')))
    rng = np.random.default_rng(1)
    start, seconds = loop.arm.measure().pose.copy(), SHOWN * PERIOD
    with bags.BagWriter(bag) as writer:
        for k in range(round(1000 * (seconds + 2.0 * WAY_S))):
            t = 1e-3 * k - WAY_S
            down = smoothstep(min(t / WAY_S + 1.0, 1.0))
            up = smoothstep(max((t - seconds) / WAY_S, 0.0))
            angle = 2.0 * np.pi * min(max(t, 0.0), seconds) / PERIOD
            target = resting_target(start)
            target[:3] += [RADIUS * (np.cos(angle) - 1.0), RADIUS * np.sin(angle),
                           -BELOW * (down - up)]
            target[WRENCH + 2] = -FORCE * smoothstep(min(max(t + 0.5, 0.0) / 0.5, 1.0)) * (1 - up)
            target[WRENCH_GAIN + 2] = GAIN
            loop.must_follow(target)
            tick = loop.tick()
            if k % SAMPLE_EVERY:
                continue
            stamp = recordings.EPOCH_NS + k * 1_000_000
            pose = tick.measurement.pose.copy()
            pose[:3] += POSITION_NOISE * rng.standard_normal(3)
            felt = tick.wrench + FORCE_NOISE * rng.standard_normal(6) * [1, 1, 1, .03, .03, .03]
            writer.pose(recordings.POSE_TOPIC, stamp, pose.tolist(), arm.frame)
            writer.wrench(WRENCH_TOPIC, stamp + 300_000, felt.tolist(), arm.frame)


def run_wiping(folder: Path, arm: ArmChoice, testbed: Opener = process_bed) -> int:
    """
    Show, learn and execute the wiping.

    :param testbed: see `gdmp_ros.ros.clients.testbed.process_bed`
    :returns: exit code: 0 if the force is kept on all tables
    :raises GdmpError: if something does not happen in time
    """
    interrupt_on_sigterm()
    arm.check()
    if arm.host:
        raise ParameterError('--task wipe puts tables under the arm: take --protocol-server '
                             'instead of --host, or another --arm')
    folder.mkdir(parents=True, exist_ok=True)
    for name in ('demonstration', 'runs', 'logs'):
        shutil.rmtree(folder / name, ignore_errors=True)
    print('wiping a table, shown to the simulated arm', flush=True)
    record_wiping(folder / 'demonstration', arm)
    print('learning', flush=True)
    figures: dict[str, Any] = {'task': 'wipe', 'arm': arm.node, 'shown_force_n': FORCE,
                               'tables': []}
    arm = with_friction(arm, folder)
    for name, topic in (('with force', WRENCH_TOPIC), ('plain', '')):
        learned = skill_from_bags([folder / 'demonstration'], LearningSettings(
            pose_topic=recordings.POSE_TOPIC, wrench_topic=topic, stiffness='none',
            rhythmic=True)).skill
        path = folder / f'{name.replace(" ", "-")}.json'
        learned.save(path)
        figures['period_s'] = learned.duration
        for height in HEIGHTS:
            print(f'{name}, table {1e3 * height:+.0f} mm', flush=True)
            figures['tables'].append({'skill': name, 'height_m': height,
                                      **_execute_wiping(folder, path, height, learned.duration,
                                                        arm, testbed)})
    kept = [figure for figure in figures['tables'] if figure['skill'] == 'with force']
    figures['succeeded'] = all(
        item['force_rmse_n'] < 0.2 * FORCE and item['least_tank_j'] > 0.0
        and not item['error'] and not item['limits_broken'] for item in kept)
    write_json(folder / 'report.json', figures)
    table('force on the table', ['skill', 'table [mm]', 'force RMSE [N]', 'mean force [N]',
                                 'least energy in the tank [J]', 'limits', 'ended'],
          [[figure['skill'], f'{1e3 * figure["height_m"]:+.0f}', f'{figure["force_rmse_n"]:.2f}',
            f'{figure["mean_force_n"]:.2f}', f'{figure["least_tank_j"]:.2f}',
            ', '.join(figure['limits_broken']) or 'kept',
            figure['error'] or 'at the goal'] for figure in figures['tables']])
    print(f'report: {folder / "report.json"}')
    return 0 if figures['succeeded'] else 1


def _execute_wiping(folder: Path, skill: Path, height: float, period: float, arm: ArmChoice,
                    testbed: Opener) -> dict[str, Any]:
    """Wipe a table through the nodes."""
    runs = folder / 'runs' / f'{skill.stem}{1e3 * height:+.0f}mm'
    world = _table(folder, height, arm)
    with arm.robot(runs / 'logs', world=world), testbed(NodeTestbed, runs, arm=arm) as bed:
        _start_arm(bed, world)
        bed.start(server={'skill': str(skill.resolve()), 'wrench_gain': GAIN,
                          'lag_position': TABLE_TOLERANCE[0]})
        # On a table that is elsewhere the tool does not reach the reference, and need not.
        bed.client.execute(ExecuteSkill.Goal(
            cycles=float(CYCLES), robot_position_tolerance=TABLE_TOLERANCE[0],
            robot_rotation_tolerance=TABLE_TOLERANCE[1]))
        result = bed.client.result(60.0)
        run = bed.recorded()
    return {'error': '' if result.error_code == result.SUCCESSFUL else result.error_string,
            **_figures(run, period, arm)}


def _table(folder: Path, height: float, arm: ArmChoice) -> dict[str, Any]:
    """What simulates an arm over a table, as parameters; arms with position servos need foam."""
    if arm.robots:
        top = home_pose(arm.model)[2] - BELOW + height
        return {'scene': 'soft_table', 'scene_height': float(top)}
    scene = folder / f'table{1e3 * height:+.0f}mm.xml'
    spec = cloth_table(BELOW - height, arm.model or 'panda')
    spec.compile()
    scene.write_text(spec.to_xml())
    return {'model': str(scene.resolve())}


def _figures(run: Run, period: float, arm: ArmChoice) -> dict[str, Any]:
    """Force, energy and limits, from the second cycle to the last one."""
    began = int(run.reference_stamps[int(np.argmax(run.moving))])
    first, last = (began + round(cycles * period * 1e9) for cycles in (1.0, CYCLES - 0.1))
    within = (run.state_stamps >= first) & (run.state_stamps <= last)
    force = run.wrenches[within, 2]
    limits, joints = limit_figures(run, arm.limits), LimitSettings()
    # Where the torques of the law are those of a virtual arm, they have no limit.
    torques = [] if arm.robots else [('torque', limits.torque, 1.0),
                                     ('torque rate', limits.torque_rate, TORQUE_RATE)]
    broken = [name for name, value, most in (
        *torques, ('joint position', -limits.joint_distance, 0.0),
        ('joint speed', limits.joint_speed, joints.joint_speed),
        ('speed', limits.speed, joints.speed)) if value > most]
    return {'force_rmse_n': float(np.sqrt(np.mean((force - FORCE) ** 2))),
            'mean_force_n': float(force.mean()), 'least_tank_j': limits.tank_energy,
            'limits_broken': broken}

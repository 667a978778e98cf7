"""Arms made for position control, with a gripper, as those of others are, become ours."""
import sys

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.position_trial import circle
from gdmp_ros import DataError
from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.control.target import POSE
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.sim.arm import Arm, PANDA
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.gripper import add_gripper, SimulatedGripper
from gdmp_ros.sim.model_sources import load
from test import urdf


def position_controlled():
    """The built-in Panda as others publish theirs: servos, fingers that slide, no tool."""
    spec = mujoco.MjSpec.from_file(str(PANDA))
    for group in (spec.actuators, spec.keys):
        for one in list(group):
            spec.delete(one)
    spec.delete(spec.site('tcp'))
    spec.option.timestep = 0.002
    for side, axis in (('left', 1.0), ('right', -1.0)):
        spec.body(f'{side}_finger').add_joint(name=f'{side}_slide', axis=[0.0, axis, 0.0],
                                              type=mujoco.mjtJoint.mjJNT_SLIDE,
                                              range=[0.0, 0.04])
    fingers = spec.add_tendon(name='fingers')
    for side in ('left', 'right'):
        fingers.wrap_joint(f'{side}_slide', 0.5)
    spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1='left_slide', name2='right_slide',
                      objtype=mujoco.mjtObj.mjOBJ_JOINT)
    for i in range(1, 8):
        limit = 87.0 if i < 5 else 12.0
        servo = spec.add_actuator(name=f'servo{i}', target=f'joint{i}',
                                  trntype=mujoco.mjtTrn.mjTRN_JOINT)
        servo.set_to_position(kp=2000.0)
        servo.ctrlrange = [-4.0, 4.0]
        servo.forcelimited, servo.forcerange = True, [-limit, limit]
    grip = spec.add_actuator(name='grip', target='fingers', trntype=mujoco.mjtTrn.mjTRN_TENDON)
    grip.set_to_position(kp=100.0)
    grip.ctrlrange = [0.0, 0.04]
    spec.add_key(name='home', qpos=[0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8, 0.02, 0.02])
    return spec


@pytest.fixture
def menagerie(tmp_path, monkeypatch):
    """A Menagerie of one arm, found as the package finds a checkout."""
    folder = tmp_path / 'franka_emika_panda'
    folder.mkdir()
    spec = position_controlled()
    spec.compile()
    (folder / 'panda.xml').write_text(spec.to_xml())
    monkeypatch.setenv('MENAGERIE_ROOT', str(tmp_path))
    return folder


def test_menageries_panda_becomes_torque_controlled_and_is_the_built_in_one(menagerie, rng):
    built_in, other = Arm(), Arm('menagerie:franka_emika_panda')
    assert other.names == built_in.names and other.model.nu == 7 and other.period == 1e-3
    np.testing.assert_array_equal(other.limits.torque, [87.0] * 4 + [12.0] * 3)
    np.testing.assert_array_equal(other.data.qpos, [0.0, -0.7, 0.0, -2.3, 0.0, 1.6, 0.8])
    for _ in range(5):
        posture = rng.uniform(built_in.limits.lower, built_in.limits.upper)
        for arm in (built_in, other):
            arm.reset(posture)
        ours, theirs = built_in.measure(), other.measure()
        np.testing.assert_allclose(theirs.pose, ours.pose, atol=1e-6)
        np.testing.assert_allclose(theirs.inertia, ours.inertia, atol=1e-5)
        np.testing.assert_allclose(theirs.bias, ours.bias, atol=1e-4)


def test_it_holds_still_under_the_impedance_law(menagerie):
    loop = ClosedLoop(Arm('menagerie:franka_emika_panda/panda'))
    begun = loop.arm.measure().pose.copy()
    for _ in range(500):
        tick = loop.tick()
    assert np.linalg.norm(tick.measurement.pose[:3] - begun[:3]) < 1e-3
    assert np.abs(tick.measurement.velocity).max() < 1e-2


def test_a_model_with_its_own_motors_stays_as_it_is():
    spec = load(str(PANDA))
    assert len(spec.actuators) == 7 and spec.option.timestep == 0.001
    gears = [motor.ctrlrange[1] for motor in spec.actuators]
    arm = Arm(spec)
    assert [m.ctrlrange[1] for m in spec.actuators] == gears and arm.model.nkey == 1


def test_motors_in_another_order_or_with_gears_are_put_right(tmp_path):
    path = tmp_path / 'arm.xml'
    path.write_text("""<mujoco><worldbody><body><joint name="j1" axis="0 0 1"/><geom size="0.1"/>
        <body pos="0.3 0 0"><joint name="j2" axis="0 1 0"/><geom size="0.1"/><site name="tcp"/>
        </body></body></worldbody><actuator>
        <motor name="m2" joint="j2" gear="10" ctrlrange="-0.5 0.5"/>
        <motor name="m1" joint="j1" ctrlrange="-50 50"/></actuator>
        <sensor><actuatorfrc actuator="m1"/></sensor></mujoco>""")
    arm = Arm(path)
    np.testing.assert_array_equal(arm.limits.torque, [50.0, 5.0])
    arm.step(np.array([1.0, 0.0]))
    np.testing.assert_allclose(arm.data.qfrc_actuator, [1.0, 0.0])


def test_what_cannot_be_had_is_said(menagerie, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'robot_descriptions', None)  # as if it were not installed
    for name, said in (('menagerie:oven', "Unknown robot 'oven'"),
                       ('menagerie:franka_emika_panda/oven', "no entry point 'oven'"),
                       ('menagerie:franka_fr3', 'not found under MENAGERIE_ROOT'),
                       ('robot_descriptions:panda_mj_description', r'\.\[models\]'),
                       (str(tmp_path / 'oven.xml'), 'there is no such file')):
        with pytest.raises(DataError, match=said):
            Arm(name)
    spec = position_controlled()
    for servo in spec.actuators:
        servo.forcelimited, servo.forcerange = False, [0.0, 0.0]
    with pytest.raises(DataError, match="joint 'joint1' has no torque limit"):
        Arm(spec, tool='flange')


def test_the_built_in_ur5e_is_where_denavit_and_hartenberg_say(rng):
    arm = Arm('ur5e', 'flange')
    for _ in range(20):
        position = rng.uniform(-np.pi, np.pi, 6)
        # The model stands in base_link, which is turned by half a turn from base.
        expected = compose(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
                           urdf.by_denavit_hartenberg(position))
        found = arm.pose_at(position)
        found[3:] *= np.sign(found[3:] @ expected[3:])
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert arm.names == list(urdf.JOINTS)
    # As the data sheet says of the arm without its base; the hand has 1 kg.
    assert arm.known.model.body_mass.sum() - 4.0 - 1.0 == pytest.approx(17.7, abs=0.01)


def test_the_built_in_xarm7_is_where_denavit_and_hartenberg_say(rng):
    """With the modified parameters of its user manual: length, twist, offset."""
    arm, right = Arm('xarm7', 'flange'), np.pi / 2.0
    parameters = ((0.0, 0.0, 0.267), (0.0, -right, 0.0), (0.0, right, 0.293),
                  (0.0525, right, 0.0), (0.0775, right, 0.3425), (0.0, right, 0.0),
                  (0.076, -right, 0.097))
    for _ in range(20):
        position, expected = rng.uniform(arm.limits.lower, arm.limits.upper), np.eye(4)
        for angle, (length, twist, offset) in zip(position, parameters):
            step = np.eye(4)
            step[:3, :3] = Rotation.from_euler('XZ', [twist, angle]).as_matrix()
            step[:3, 3] = [length, -np.sin(twist) * offset, np.cos(twist) * offset]
            expected = expected @ step
        found = arm.pose_at(position)
        np.testing.assert_allclose(found[:3], expected[:3, 3], atol=1e-12)
        np.testing.assert_allclose(Rotation.from_quat(found[3:], scalar_first=True).as_matrix(),
                                   expected[:3, :3], atol=1e-12)


@pytest.mark.parametrize('model', ['ur5e', 'xarm7'])
@pytest.mark.parametrize('stiffness', [300.0, 800.0])
def test_other_arms_follow_a_circle_with_the_impedance_law(stiffness, model):
    loop = ClosedLoop(Arm(model))
    references = circle(loop.arm.measure().pose, stiffness, 5.0, cycle=1e-3)
    poses = loop.follow_all(references)
    errors = np.linalg.norm(poses[:, :3] - references[:, POSE:POSE + 3], axis=1)
    assert np.sqrt((errors ** 2).mean()) < 5e-4 and errors.max() < 1.5e-3
    assert loop.controller.counters.recent() == ''


def test_the_hand_of_the_ur5e_closes_on_something():
    arm = Arm('ur5e', extras=[add_gripper])
    gripper = SimulatedGripper(arm.model, arm.data)
    loop = ClosedLoop(arm, gripper=gripper)
    gripper.command(GripperCommand(0.02))
    for _ in range(1500):
        loop.tick()
    assert gripper.state.width == pytest.approx(0.02, abs=2e-3) and not gripper.state.problem

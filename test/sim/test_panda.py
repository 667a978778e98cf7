"""The built-in Panda against the robot's published figures, and the closed loop around it."""
import numpy as np
import pytest

from gdmp_ros import Rollout, Skill
from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.target import resting_target
from gdmp_ros.data import lasa
from gdmp_ros.errors import DataError, RefusedError
from gdmp_ros.manifolds.quaternion import rotation_between
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.settings import PlayerSettings
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.execution import execution_ticks

READY = np.array([0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4])


def test_forward_kinematics_of_the_ready_pose():
    arm = Arm()
    np.testing.assert_allclose(arm.data.qpos, READY, atol=1e-12)
    np.testing.assert_allclose(arm.site_pose('flange')[:3], [0.3069, 0, 0.5903], atol=1e-4)
    tool = arm.site_pose('tcp')
    np.testing.assert_allclose(tool[:3], [0.3069, 0, 0.4869], atol=1e-4)
    rotation = arm.data.site('tcp').xmat.reshape(3, 3)
    np.testing.assert_allclose(rotation, np.diag([1.0, -1, -1]), atol=1e-9)


def denavit_hartenberg(q):
    """Flange pose by the robot's DH table (Craig), independent of the model file."""
    table = [(0, 0.333, 0), (0, 0, -np.pi / 2), (0, 0.316, np.pi / 2), (0.0825, 0, np.pi / 2),
             (-0.0825, 0.384, -np.pi / 2), (0, 0, np.pi / 2), (0.088, 0, np.pi / 2),
             (0, 0.107, 0)]
    pose = np.eye(4)
    for (a, d, alpha), theta in zip(table, [*q, 0.0]):
        ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
        pose = pose @ np.array([[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa],
                                [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]])
    return pose


def test_forward_kinematics_follow_the_dh_table(rng):
    arm = Arm()
    for _ in range(20):
        q = rng.uniform(arm.limits.lower, arm.limits.upper)
        arm.reset(q)
        expected = denavit_hartenberg(q)
        np.testing.assert_allclose(arm.data.site('flange').xpos, expected[:3, 3], atol=1e-9)
        np.testing.assert_allclose(arm.data.site('flange').xmat.reshape(3, 3), expected[:3, :3],
                                   atol=1e-9)


def test_gravity_torque_without_the_hand():
    arm = Arm(tool='flange', hand=False)
    np.testing.assert_allclose(arm.measure().bias, [0, -1.77, -0.64, 18.57, 0.63, 1.69, 0],
                               atol=0.02)


def test_task_inertia_without_the_hand():
    measured = Arm(tool='flange', hand=False).measure()
    inverse = measured.jacobian @ np.linalg.solve(measured.inertia, measured.jacobian.T)
    np.testing.assert_allclose(np.diag(np.linalg.inv(inverse))[:3], [11.7, 4.4, 5.8], atol=0.06)


def test_joint_and_torque_limits_are_the_robots():
    limits = Arm().limits
    np.testing.assert_allclose(limits.torque, [87] * 4 + [12] * 3)
    np.testing.assert_allclose(limits.lower, [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973,
                                              -0.0175, -2.8973])


def test_bad_models_are_refused(tmp_path):
    with pytest.raises(DataError, match='there is no such file'):
        Arm(tmp_path / 'nothing.xml')
    (tmp_path / 'broken.xml').write_text('<mujoco><worldbody>')
    with pytest.raises(DataError, match='broken.xml'):
        Arm(tmp_path / 'broken.xml')
    with pytest.raises(DataError, match="no site 'nose'"):
        Arm(tool='nose')
    (tmp_path / 'free.xml').write_text('<mujoco><worldbody><body><freejoint/><geom size="1"/>'
                                       '<site name="tcp"/></body></worldbody></mujoco>')
    with pytest.raises(DataError, match='neither a hinge nor a slide'):
        Arm(tmp_path / 'free.xml')
    (tmp_path / 'stiff.xml').write_text('<mujoco><worldbody><site name="tcp"/></worldbody>'
                                        '</mujoco>')
    with pytest.raises(DataError, match='0 motors for 0'):
        Arm(tmp_path / 'stiff.xml')


def test_the_arm_holds_still_without_references():
    loop = ClosedLoop(Arm())
    start = loop.arm.measure().pose.copy()
    for _ in range(1000):
        loop.tick()
    assert np.linalg.norm(loop.arm.measure().pose - start) < 1e-6


def test_a_stream_that_begins_right_after_the_warm_up_is_followed():
    loop = ClosedLoop(Arm())
    loop.warm_up(loop.arm.measure(), loop.arm.period)
    guard, target = loop.controller.guard, resting_target(loop.arm.measure().pose)
    for sequence in range(1, 4):
        assert guard.offer(target, Origin(guard.settings.frame, sequence=sequence))
        loop.tick()
    assert guard.following and guard.refused == 0


def test_a_learned_letter_is_tracked_through_a_goal_switch(letter):
    loop = ClosedLoop(Arm())
    player = Player(letter, PlayerSettings())
    player.start(loop.arm.measure().pose.copy())
    position, rotation, torques, error = [], [], [], np.empty(3)
    for k in range(9000):
        if k == 2400:
            goal = letter.goal[:7].copy()
            goal[1] -= 0.12
            player.go_to(goal)
        target = player.tick(1e-3)
        assert loop.follow(target)
        tick = loop.tick()
        position.append(np.linalg.norm(tick.measurement.pose[:3] - target[:3]))
        rotation_between(tick.measurement.pose[3:].copy(), target[3:7].copy(), error)
        rotation.append(np.linalg.norm(error))
        torques.append(tick.torque)
    assert player.rollout.finished
    assert np.sqrt(np.mean(np.square(position))) < 0.010
    assert np.sqrt(np.mean(np.square(rotation))) < 0.03
    assert np.linalg.norm(loop.arm.measure().pose[:3] - goal[:3]) < 0.002
    assert (np.abs(torques) <= loop.arm.limits.torque).all()
    assert np.abs(np.diff(torques, axis=0)).max() <= 1.0 + 1e-9


def test_external_forces_are_felt_at_the_tool():
    loop = ClosedLoop(Arm())
    body = loop.arm.model.body('hand').id
    loop.arm.data.xfrc_applied[body, :3] = [3.0, -2.0, 4.0]
    for _ in range(3000):
        tick = loop.tick()
    np.testing.assert_allclose(tick.wrench[:3], [3.0, -2.0, 4.0], atol=0.3)
    # A spring of 400 N/m yields by the force over its stiffness.
    yielded = tick.measurement.pose[:3] - Arm().measure().pose[:3]
    np.testing.assert_allclose(yielded, np.array([3.0, -2.0, 4.0]) / 400.0, atol=1e-3)


def test_rollouts_of_the_tool_skill_stay_in_the_workspace(letters):
    points = np.vstack([d.points[:, :3] for d in letters])
    assert 0.24 < np.ptp(points, axis=0).max() < 0.26
    path = Rollout(Skill.learn(letters)).sample(np.linspace(0, 6, 200)).points
    assert (np.abs(path[:, :3] - lasa.CENTRE_M) < 0.2).all()


def test_after_a_reset_the_next_roll_out_is_followed_like_the_first(letter):
    loop, away = ClosedLoop(Arm()), []
    for _ in range(2):
        loop.reset()
        away.append([np.linalg.norm(tick.measurement.pose[:3] - target[:3])
                     for target, tick in execution_ticks(letter, loop, rest_s=0.1)])
    assert max(away[0]) < 5e-3
    np.testing.assert_allclose(away[1], away[0], atol=1e-9)
    assert loop.controller.guard.refused == 0


def test_an_arm_that_does_not_follow_is_an_error(skill):
    loop = ClosedLoop(Arm())
    loop.controller.guard.fault('a test')
    with pytest.raises(RefusedError, match=r'does not follow .*a fault \(a test\)'):
        next(execution_ticks(skill, loop))
    # A stream that goes on over a reset is not followed from its middle.
    loop.reset()
    ticks = execution_ticks(skill, loop)
    for _ in range(100):
        next(ticks)
    loop.do(Request.RESET)
    with pytest.raises(RefusedError, match='began before the arm was ready'):
        next(ticks)

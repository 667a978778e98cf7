"""A model of an arm from its URDF: kinematics, limits, what is assumed, and what is refused."""
import numpy as np
import pytest

from experiments.position_trial import circle, CYCLE
from gdmp_ros.errors import GdmpError
from gdmp_ros.manifolds.quaternion import rotation_angles
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.servo_arm import PositionLoop, ServoArm
from gdmp_ros.sim.urdf_model import model_of
from test.commands import gdmp
from test.urdf import by_denavit_hartenberg, JOINTS, ur5e

HOME = np.array([0.0, -1.57, 1.57, -1.57, -1.57, 0.0])


@pytest.fixture(scope='module')
def urdf(tmp_path_factory):
    path = tmp_path_factory.mktemp('robot') / 'robot.urdf'
    path.write_text(ur5e())
    return path


@pytest.fixture(scope='module')
def model(urdf):
    """The model, as a file."""
    path = urdf.with_suffix('.xml')
    done = gdmp('arm', 'model', urdf, '--tip', 'tool0', '--home', *HOME, '-o', path)
    assert done.returncode == 0, done.stderr
    assert 'frame of the base: base_link' in done.stdout and 'warning' not in done.stdout
    assert 'assumed: a mass of 0.1 kg for base_link' in done.stdout
    assert 'a capsule with a radius of 0.05 m along base_link_inertia, upper_arm_link' in (
        done.stdout)
    return path


def test_it_has_the_kinematics_and_the_limits_of_the_urdf(model, rng):
    arm = Arm(str(model))
    assert arm.names == list(JOINTS)
    np.testing.assert_array_equal(arm.home, HOME)
    np.testing.assert_allclose(arm.limits.upper, [2 * np.pi] * 2 + [np.pi] + [2 * np.pi] * 3,
                               rtol=1e-5)
    assert (arm.limits.torque == 150.0).all() and (arm.limits.speed == 3.14).all()
    for position in rng.uniform(-3.0, 3.0, (20, 6)):
        pose, expected = arm.pose_at(position), by_denavit_hartenberg(position)
        # The frame of Denavit and Hartenberg is `base`, half a turn away.
        np.testing.assert_allclose(pose[:3], expected[:3] * [-1.0, -1.0, 1.0], atol=1e-6)
    assert len(arm.shape.capsules) == 5


def test_it_is_controlled_by_torques_and_by_positions(model):
    loop = ClosedLoop(Arm(str(model)))
    start = loop.arm.measure().pose
    for reference in circle(start, 800.0, cycle=1e-3)[:2000]:
        loop.must_follow(reference)
        loop.tick()
    assert np.linalg.norm(loop.arm.measure().pose[:3] - reference[:3]) < 2e-3
    servo = ServoArm(str(model))
    assert servo.hand.mass == pytest.approx(0.1)
    other = PositionLoop(servo)
    for reference in circle(start, 800.0)[:1000]:
        other.must_follow(reference)
        other.tick()
    pose = servo.arm.site_pose('tcp')
    assert np.linalg.norm(pose[:3] - reference[:3]) < 2e-3
    assert rotation_angles(pose[None, 3:], reference[None, 3:7]).max() < 5e-3
    assert other.servo.cycle == CYCLE


@pytest.mark.parametrize(('change', 'tip', 'home', 'reason'), [
    (('', ''), 'hand', HOME, "there is no link 'hand'; there are base_link"),
    (('', ''), 'tool0', HOME[:5], 'the home posture has 5 numbers, expected 6: shoulder_pan'),
    (('', ''), 'tool0', HOME + 5.0, 'elbow_joint is 6.57 rad, expected -3.142 to 3.142'),
    ((' effort="150"', ''), 'tool0', HOME, "'shoulder_pan_joint' has no torque limit"),
    ((' velocity="3.14"', ''), 'tool0', HOME, 'no velocity="…" in the limit of shoulder_pan'),
    (('<robot', '<arm'), 'tool0', HOME, 'it is not XML')])
def test_what_says_too_little_is_refused(tmp_path, change, tip, home, reason):
    path = tmp_path / 'robot.urdf'
    path.write_text(ur5e().replace(*change) if change[0] else ur5e())
    with pytest.raises(GdmpError) as error:
        model_of(path, tip, home)
    assert reason in str(error.value)


def test_a_singular_home_posture_is_told_and_what_exists_is_kept(urdf, tmp_path):
    path = tmp_path / 'robot.xml'
    done = gdmp('arm', 'model', urdf, '--tip', 'tool0', '--home', *[0] * 6, '-o', path)
    assert done.returncode == 0 and 'nearly singular' in done.stdout
    kept = path.read_text()
    done = gdmp('arm', 'model', urdf, '--tip', 'nothing', '--home', *[0] * 6, '-o', path)
    assert done.returncode == 1 and "there is no link 'nothing'" in done.stderr
    assert path.read_text() == kept

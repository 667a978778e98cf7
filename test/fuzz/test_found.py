"""Inputs found by fuzzing that were handled wrongly once."""
import ast
import copy
import importlib
import importlib.util
import json
from pathlib import Path

from gdmp_msgs.srv import LearnSkill
from geometry_msgs.msg import PoseStamped
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Header

from gdmp_ros.control import limits
from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.settings import ControllerSettings, GuardSettings, LimitSettings
from gdmp_ros.control.target import HOLD_STIFFNESS, TARGET_SIZE
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ManifoldError, ParameterError
from gdmp_ros.manifolds import from_spec
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.manifolds.sphere import Sphere
from gdmp_ros.ros import messages
from gdmp_ros.ros.serialized import PoseReader
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from test.fuzz.entrances import server, short_skill


@pytest.fixture
def document(tmp_path):
    path = tmp_path / 'skill.json'
    short_skill().save(path)
    return json.loads(path.read_text())


@pytest.mark.parametrize('names', [1, 2.5, True, [{}, {}, {}], 'abc', ['a']])
def test_names_of_factors_that_are_none(document, tmp_path, names):
    changed = copy.deepcopy(document)
    changed['manifold']['names'] = names
    path = tmp_path / 'changed.json'
    path.write_text(json.dumps(changed))
    with pytest.raises(DataError, match='names'):
        Skill.load(path)


@pytest.mark.parametrize('m', [2 ** 70, 10 ** 6, -1])
def test_sizes_nobody_has_memory_for(m):
    with pytest.raises(ManifoldError, match='m must be an integer from 1 to 1000'):
        from_spec({'kind': 'spd', 'm': m})
    assert Sphere(1000).dim == 1000


@pytest.mark.parametrize('size', [1e308, 1e200, 1e-300])
def test_matrices_whose_sums_overflow(size):
    manifold = SymmetricPositiveDefinite(2)
    with pytest.raises(ManifoldError, match='smallest eigenvalue'):
        manifold.check_point(size * np.array([[1.0, 1.5], [1.5, 1.0]]))
    assert np.isfinite(manifold.check_point(size * np.eye(2))).all()


def reference():
    target = np.zeros(TARGET_SIZE)
    target[:7], target[19:55], target[55] = (Arm().measure().pose, HOLD_STIFFNESS.reshape(-1),
                                             0.7)
    return target


@pytest.mark.parametrize('index, value, reason', [
    (8, 1e300, 'a number is 1e+300'), (15, -1e12, 'a number is 1e+12'),
    (2, 1e9, 'a number is 1e+09'), (55, 1e5, 'damping ratio is 1e+05, expected 0 to 2')])
def test_finite_numbers_whose_products_are_not(index, value, reason):
    guard = ReferenceGuard(GuardSettings(), reference()[:7], 0.7)
    target = reference()
    target[index] = value
    assert not guard.offer(target, Origin('panda_link0'))
    assert reason in guard.last_refusal


def test_a_torque_that_cannot_be_computed_is_never_sent():
    loop = ClosedLoop(Arm())
    for _ in range(50):
        loop.tick()
    loop.controller.memory.governed[:] = np.nan
    tick = loop.tick()
    assert np.isfinite(tick.torque).all() and tick.violation[limits.TORQUE] == np.inf
    assert tick.tank == 0.0  # what was drawn is not known
    assert np.isfinite(loop.tick().tank)
    assert 'torque by inf Nm' in loop.controller.counters.recent()
    start = loop.arm.measure().pose.copy()
    for _ in range(1000):
        tick = loop.tick()
        assert np.isfinite(tick.torque).all()
    assert np.linalg.norm(loop.arm.measure().pose - start) < 1e-3


@pytest.mark.parametrize('potential', [np.nan, 0.0])
def test_a_measurement_that_is_none_is_answered_with_the_last_torque(potential):
    loop = ClosedLoop(Arm())
    for _ in range(50):
        last = loop.tick()
    measured = loop.arm.measure()
    broken = measured._replace(bias=np.full(7, np.nan), potential=potential)
    for _ in range(3):
        tick = loop.controller.tick(broken, 1e-3)
        np.testing.assert_array_equal(tick.torque, last.torque)
    for _ in range(500):
        tick = loop.tick()
        assert np.isfinite(tick.torque).all() and np.isfinite(tick.tank)
    assert np.isfinite(loop.controller.memory.scalars.coriolis)


@pytest.mark.parametrize('acceleration', [13.0, 100.0, 1e5])
@pytest.mark.parametrize('damping_ratio', [0.1, 0.7])
def test_an_acceleration_that_the_pose_does_not_have_drives_nothing_far(acceleration,
                                                                        damping_ratio):
    loop = ClosedLoop(Arm())
    start, target = loop.arm.measure().pose.copy(), reference()
    ticks, furthest = [], 0.0
    for k in range(3000):
        push = acceleration * (1.0 if k // 150 % 2 else -1.0)
        target[55], target[7], target[13] = damping_ratio, min(5e-4 * push, 9.0), push
        loop.follow(target)
        ticks.append(loop.tick())
        furthest = max(furthest, float(np.linalg.norm(ticks[-1].measurement.pose[:3]
                                                      - start[:3])))
    assert min(tick.tank for tick in ticks) > -0.05
    assert furthest < (0.15 if acceleration < 1e4 else 0.7)
    assert max(np.abs(tick.measurement.velocity).max() for tick in ticks) < 2.175


def test_an_acceleration_of_a_pose_at_rest_moves_the_tool_a_little():
    """3 m/s^2 of it are used: with the 12.5 kg that the tool weighs along x, 94 mm at 400 N/m."""
    loop = ClosedLoop(Arm())
    start, furthest, target = loop.arm.measure().pose.copy(), 0.0, reference()
    target[13] = 13.0
    for _ in range(1500):
        loop.follow(target)
        furthest = max(furthest, np.linalg.norm(loop.tick().measurement.pose[:3] - start[:3]))
    assert furthest < 0.1


def test_a_wall_is_kept_by_a_fast_reference():
    start = Arm().measure().pose[0]
    wall = start + 0.1
    loop = ClosedLoop(Arm(), ControllerSettings(limits=LimitSettings(
        workspace_max=(wall, 1.0, 1.3))))
    target = reference()
    loop.controller.guard.arm()
    for k in range(600):
        target[0], target[7] = start + 1e-3 * k, 1.0
        loop.follow(target)
        loop.tick()
        assert loop.controller.reference[0] <= wall + 1e-6
    assert loop.controller.reference[0] > start + 0.05


@pytest.mark.parametrize('coordinate', [1e307, -1e7])
def test_poses_whose_distances_overflow(coordinate):
    message = PoseStamped(header=Header(frame_id='panda_link0'))
    message.pose.position.y = coordinate
    with pytest.raises(ManifoldError, match='a coordinate of the pose is 1e'):
        messages.checked_pose(message, 'panda_link0')
    with pytest.raises(ManifoldError, match='a coordinate of the pose is 1e'):
        PoseReader('panda_link0').read(serialize_message(message))


@pytest.mark.parametrize('fields', [
    {'bags': ['--each', '-o', 'elsewhere.json']}, {'bags': ['demo'], 'output': '--resume'}])
def test_names_of_bags_are_never_options(fields):
    _, command = server().node._learning.command(LearnSkill.Request(**fields))
    named = command[command.index('--') + 1:]
    assert named == fields['bags']
    assert not {'--each', '--resume', '-o'} & set(command[:command.index('--')])


def test_a_connection_that_is_none_is_refused_before_anything_is_started():
    with pytest.raises(ParameterError, match="connection is '--help'"):
        server().node._learning.command(LearnSkill.Request(bags=['x'], connection='--help'))


@pytest.mark.parametrize('path', ['/dev/zero', '/', '/dev/stdin'])
def test_a_skill_file_that_is_not_a_file(path):
    with pytest.raises(DataError, match='it is a folder or a device'):
        Skill.load(path)


def test_products_with_names_as_a_tuple_still_work():
    assert Product(Sphere(2), Sphere(1), names=('a', 'b')).names == ('a', 'b')


def test_what_the_fuzzers_import_when_they_run_exists():
    for path in Path(__file__).parent.glob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module.startswith(
                    ('gdmp_ros', 'experiments')):
                module = importlib.import_module(node.module)
                for name in node.names:
                    assert hasattr(module, name.name) or importlib.util.find_spec(
                        f'{node.module}.{name.name}'), f'{path.name}: {name.name}'

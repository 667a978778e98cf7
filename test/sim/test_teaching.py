"""A hand guides a simulated arm."""
import mujoco
import numpy as np
import pytest

from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.scenes import Box, boxes, CAN_MASS, contact_count, watering
from gdmp_ros.sim.teaching import demonstrate, GuidingHand, Timing
from gdmp_ros.view.films import render_to

DOWN = np.array([0.0, 1.0, 0.0, 0.0])


def hand(stiffness=400.0, **options):
    def intends(progress):
        return np.concatenate([[0.40 + 0.08 * progress, 0.05 * progress, 0.42],
                               [1.0, 0.0, 0.0, 0.0]])
    return GuidingHand(intends, lambda _: stiffness * np.eye(3), 40.0, **options)


@pytest.fixture(scope='module')
def taught():
    arm = Arm(watering())
    return demonstrate(arm, 'can', hand(), Timing(1.5), np.random.default_rng(1))


def test_the_can_follows_the_hand(taught):
    assert taught.positions[-1] == pytest.approx([0.48, 0.05, 0.42], abs=0.05)
    rates = np.gradient(taught.positions, taught.times, axis=0)
    assert np.abs(rates - taught.velocities)[5:-5].max() < 0.02


def test_newtons_law_holds_between_hand_wrist_and_can(taught):
    """M a = f + F with F the spring and damper of the hand; the rest is its tremor."""
    own = hand()
    acceleration = np.gradient(taught.velocities, taught.times, axis=0)
    left = []
    for i in range(50, len(taught.times) - 50, 20):
        wanted = own.intended_pose(taught.progress[i])[:3]
        force = 400.0 * (wanted - taught.positions[i]) - 40.0 * taught.velocities[i]
        left.append(CAN_MASS * acceleration[i] - taught.forces[i] - force)
    assert np.abs(left).max() < 4.0 * own.tremor
    assert np.abs(taught.forces).max() > 10.0 * own.tremor


@pytest.mark.parametrize('body', ['hand', 'can'])
def test_velocities_are_those_of_the_centre_of_mass(body, rng):
    arm = Arm(watering())
    arm.data.qvel[:] = rng.uniform(-0.5, 0.5, 7)
    mujoco.mj_forward(arm.model, arm.data)
    guided, linear = arm.model.body(body).id, np.zeros((3, 7))
    mujoco.mj_jacBodyCom(arm.model, arm.data, linear, None, guided)
    wanted = linear @ arm.data.qvel
    shown = demonstrate(arm, body, hand(), Timing(0.01), rng)
    assert shown.velocities[0] == pytest.approx(wanted, abs=1e-9)


def test_contacts_with_a_box_are_counted_and_others_are_not():
    arm = Arm(boxes([Box((0.31, 0.0), (0.15, 0.15), 0.45)]))
    assert contact_count(arm.model, arm.data, 'box') == 0
    arm = Arm(boxes([Box((0.31, 0.15), (0.15, 0.15), 0.6)]))
    assert contact_count(arm.model, arm.data, 'box') > 0
    assert contact_count(arm.model, arm.data, 'tray') == 0


def test_films_and_pictures_are_written(tmp_path):
    from PIL import Image
    scene = tmp_path / 'scene.xml'
    scene.write_text(watering().to_xml())
    arm = Arm(scene)
    joints = np.array([arm.data.qpos + 0.1 * i for i in range(3)])
    path = np.array([[0.4, 0.0, 0.4]])
    if render_to(tmp_path / 'one.png', joints[0], path, scene) is not None:
        pytest.skip('no way to render off screen')
    assert Image.open(tmp_path / 'one.png').size == (960, 720)
    assert render_to(tmp_path / 'film.webp', joints, path, scene) is None
    assert Image.open(tmp_path / 'film.webp').n_frames == 3
    assert sorted(p.name for p in tmp_path.iterdir()) == ['film.webp', 'one.png', 'scene.xml']


@pytest.mark.parametrize('behind', [(-0.12, 0.1), (-0.12, -0.1), (0.12, 0.1), (0.12, -0.1)])
def test_a_path_is_seen_wherever_it_is(tmp_path, behind):
    from PIL import Image
    heights = np.linspace(0.1, 0.3, 20)
    path = np.column_stack([np.full(20, behind[0]), np.full(20, behind[1]), heights])
    if render_to(tmp_path / 'one.png', Arm().data.qpos, path) is not None:
        pytest.skip('no way to render off screen')
    red, green, blue = np.asarray(Image.open(tmp_path / 'one.png')).astype(int)[..., :3].T
    # All of it: a line of 0.2 m is 105 pixels high.
    assert ((red > 2 * green) & (red > 2 * blue)).any(axis=0).sum() > 100

"""A stiffness that is streamed, beside an admittance with fixed gains; in lockstep."""
import numpy as np
import pytest

from experiments.baselines.admittance import DiagonalAdmittance
from experiments.bench import stiffness
from experiments.position_trial import FAST
from experiments.timing import TimingSettings
from gdmp_ros.sim.servo_arm import ServoArm


def test_the_peer_gives_way_by_the_force_over_its_stiffness():
    servo = ServoArm('ur5e', FAST)
    home, damping = servo.arm.measure().pose.copy(), np.array([400.0] * 3 + [4.0] * 3)
    peer = DiagonalAdmittance(servo, np.array([1500.0, 500.0, 1500.0, *[30.0] * 3]), damping,
                              np.array([2.0] * 3 + [0.02] * 3))
    # Its axes are those of the tool, whose x is along the y of the base.
    servo.arm.push(np.array([0.0, 15.0, 0.0, 0.0, 0.0, 0.0]))
    for _ in range(1000):
        peer.tick(home)
    moved = servo.arm.measure().pose[:3] - home[:3]
    assert moved[1] == pytest.approx(15.0 / 1500.0, rel=0.05)
    assert np.abs(np.delete(moved, 1)).max() < 1e-3
    assert peer.wrench[1] == pytest.approx(15.0, abs=1.5)


@pytest.mark.long
def test_what_is_streamed_is_accurate_in_the_air_and_soft_in_contact(monkeypatch):
    monkeypatch.setattr(stiffness, 'HEIGHTS', (0.01,))
    monkeypatch.setattr(stiffness, 'PLACES', ((0.0015, 0.0),))
    made = stiffness.run(TimingSettings())
    wiping, insertion = made['wiping'], made['insertion']
    ours, stiff, soft = (wiping[name] for name in ('streamed', 'fixed, stiff', 'fixed, soft'))
    assert ours['contact_lost'] == 0.0
    assert ours['free_m'] < 0.6 * soft['free_m']
    assert ours['force_off_n'] < 0.5 * stiff['force_off_n']
    assert insertion['streamed']['inserted'] == 1.0
    assert insertion['fixed, soft aside']['inserted'] == 0.0
    assert len(stiffness.rows(made)) == 9

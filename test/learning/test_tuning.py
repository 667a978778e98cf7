"""Settings are suggested from demonstrations."""
import shlex

import numpy as np
import pytest
import yaml

from gdmp_ros import DataError, Demonstration, Skill
from gdmp_ros.cli.main import main
from gdmp_ros.data import lasa, recordings
from gdmp_ros.learning import tuning
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.util.profiles import minimum_jerk
from test.commands import gdmp
from test.pictures import drawn

TIMES = np.linspace(0.0, 2.0, 400)
STILL = np.tile([1.0, 0.0, 0.0, 0.0], (len(TIMES), 1))


def pose(x, y, z):
    positions = np.column_stack(np.broadcast_arrays(x, y, z))
    return Demonstration(TIMES, np.hstack([positions, STILL]), tool_manifold(None))


def smooth():
    return minimum_jerk(TIMES / 2.0)


def test_finer_motions_need_more_basis_functions():
    plain = tuning.basis_errors([pose(0.3 * smooth(), 0.0, 0.0)])
    wavy = tuning.basis_errors([pose(0.3 * smooth(),
                                     0.02 * np.sin(12.0 * np.pi * smooth()), 0.0)])
    assert tuning.sufficient_basis(plain) < tuning.sufficient_basis(wavy)
    assert [one.functions for one in plain] == list(tuning.COUNTS)
    assert all(np.isnan(one.unseen) for one in plain)
    assert wavy[0].training > 10.0 * wavy[-1].training


@pytest.mark.long
def test_details_smaller_than_the_spread_of_the_takes_are_ignored():
    wave = 0.01 * np.sin(12.0 * np.pi * smooth())
    alike = [pose(0.3 * smooth(), wave + 1e-5 * i, 0.0) for i in range(3)]
    apart = [pose(0.3 * smooth(), 0.5 * wave + 0.3 * i * np.sin(np.pi * smooth()), 0.0)
             for i in range(3)]
    errors = tuning.basis_errors(apart)
    assert tuning.sufficient_basis(errors) < tuning.sufficient_basis(tuning.basis_errors(alike))
    assert all(one.unseen > one.training for one in errors)


def test_a_larger_goal_gain_is_faster_and_adds_more():
    skill = Skill.learn(pose(0.3 * smooth(), 0.004 * np.sin(8.0 * np.pi * smooth()), 0.0))
    switches = tuning.goal_switches(skill, 0.32)
    assert (np.diff([one.acceleration for one in switches]) > 0.0).all()
    assert (np.diff([one.reached for one in switches]) < 0.0).all()
    gain = tuning.smooth_gain(switches)
    assert switches[0].gain < gain < switches[-1].gain
    assert all((one.acceleration <= tuning.SMOOTH_SWITCH) == (one.gain <= gain)
               for one in switches)


def test_speeds_are_those_of_the_fastest_demonstration():
    slow = pose(0.3 * smooth(), 0.0, 0.0)
    fast = Demonstration(0.5 * TIMES, slow.points, slow.manifold)
    skill = Skill.learn([slow, fast])
    found = tuning.speeds([slow, fast], skill)
    assert found.speed == pytest.approx(0.3 * 1.875 / 1.0, rel=0.02)
    assert found.angular_speed == pytest.approx(0.0, abs=1e-6)


def test_stiffness_costs_the_same_force_at_two_standard_deviations(rng):
    # ±1 cm along y in the first half, ±1 mm elsewhere and along the other axes.
    shown = []
    for _ in range(40):
        dx, dy, dz = rng.normal(0.0, [0.001, 0.01, 0.001])
        shown.append(pose(0.3 * TIMES / 2.0 + dx, dy * (TIMES < 1.0) + 0.1 * dy, dz))
    low, high = tuning.stiffness_bounds(shown, 10.0)
    assert low == pytest.approx(10.0 / (2.0 * 0.011), rel=0.3)
    assert high == tuning.LARGEST_STIFFNESS  # 5000 N/m at 1 mm is more than any suggestion
    softer = tuning.stiffness_bounds(shown, 1.0)
    assert softer[1] == pytest.approx(1.0 / (2.0 * 0.001), rel=0.3)
    with pytest.raises(DataError, match='at least 2'):
        tuning.stiffness_bounds(shown[:1], 10.0)


def test_the_suggested_command_learns_and_the_parameters_fit_the_nodes(tmp_path):
    for i, shown in enumerate(lasa.robot_demonstrations('GShape')[:3]):
        recordings.write(tmp_path / 'demos' / f'take_{i}', shown, 'base', recordings.EPOCH_NS)
    done = gdmp('learn', 'demos', '--suggest', '--plot', 'tune.png', '--write', 'tuned.yaml',
                cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    command = done.stdout.splitlines()[done.stdout.splitlines().index('learn with:') + 1]
    again = gdmp(*shlex.split(command)[1:], cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    count = int(command.split('--n-basis ')[1].split()[0])
    assert Skill.load(tmp_path / 'skill.json').n_basis == count
    assert drawn(tmp_path / 'tune.png') > 0.01
    from gdmp_ros.ros.parameter_tables import NODES
    for node, content in yaml.safe_load((tmp_path / 'tuned.yaml').read_text()).items():
        specs = {spec.name: spec for spec in NODES[node.removeprefix('/**/')][1]}
        for name, value in content['ros__parameters'].items():
            assert specs[name].problem(value) is None


def test_a_missing_folder_and_a_force_of_zero_are_refused(tmp_path, capsys):
    assert main(['learn', str(tmp_path / 'nowhere'), '--suggest']) == 1
    assert 'nowhere' in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(['learn', str(tmp_path), '--suggest', '--force', '0'])
    assert 'force' in capsys.readouterr().err


@pytest.mark.long
def test_the_number_suggested_for_letters_is_sensible():
    shown = [Demonstration(d.times, d.points[:, :7], tool_manifold(None))
             for d in lasa.robot_demonstrations('GShape')[:3]]
    assert 16 <= tuning.sufficient_basis(tuning.basis_errors(shown)) <= 48

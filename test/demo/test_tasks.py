"""Tasks that are shown by hand, learned and executed, with the nodes in lockstep."""
import json

import pytest

from gdmp_ros.demo.tasks import run_task, run_wiping
from gdmp_ros.ros.arm_choice import ArmChoice
from test.lockstep.bed import lockstep_bed

pytestmark = pytest.mark.long


def report(folder):
    return json.loads((folder / 'report.json').read_text())


@pytest.mark.parametrize('kind', ['sim', 'ur5e'])
def test_a_pick_is_shown_learned_and_executed(tmp_path, kind):
    assert run_task('pick', tmp_path, ArmChoice(kind), lockstep_bed) == 0
    made = report(tmp_path)
    assert made['succeeded'] and made['task'] == 'pick' and not made.get('error')


def test_a_pick_goes_through_objects_of_which_one_is_pushed_into_the_way(tmp_path):
    assert run_task('clutter', tmp_path, ArmChoice(), lockstep_bed) == 0
    made = report(tmp_path)
    assert made['placed'] and made['clearance']['contacts'] == 0
    assert made['clearance']['least_m'] > made['clearance']['margin_m']


@pytest.mark.parametrize('kind', ['sim', 'ur5e'])
def test_a_skill_of_the_joints_is_shown_learned_and_executed(tmp_path, kind):
    assert run_task('joints', tmp_path, ArmChoice(kind), lockstep_bed) == 0
    assert report(tmp_path)['succeeded']


def test_a_motion_between_objects_is_shown_once_and_executed_where_they_are(tmp_path):
    assert run_task('objects', tmp_path, ArmChoice(), lockstep_bed) == 0
    made = report(tmp_path)
    assert [place['error'] for place in made['places']] == 4 * ['']
    assert made['places'][-1]['hole_speed_m_s'] > 0.0 and made['succeeded']


@pytest.mark.parametrize('kind', ['sim', 'ur5e'])
def test_wiping_is_shown_learned_and_executed(tmp_path, kind):
    assert run_wiping(tmp_path, ArmChoice(kind), lockstep_bed) == 0
    made = report(tmp_path)
    assert made['succeeded'] and len(made['tables']) == 6

"""
The robot's protocol itself, with the nodes as processes.

On a machine that pauses the robot ends a motion. That may happen here: what matters is that the
node says so, and recovers.
"""
import json
import os

import pytest
from std_srvs.srv import Trigger

from experiments import timing
from experiments.bench import franka as bench
from experiments.reliability.trial import short_skill
from gdmp_ros.demo.run import run_demo
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.franka import protocol_server
from gdmp_ros.franka.doctor import examine
from gdmp_ros.realtime.doctor import BAD, GOOD
from gdmp_ros.ros.arm_choice import FRANKA
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import process_bed, SERVER
from gdmp_ros.sim.scenes import cloth_table
from test.franka.bed import choice, FAULT, FrankaBed
from test.franka.server import Server

try:
    protocol_server.interpreter()
    MISSING = ''
except DataError as error:
    MISSING = str(error)
pytestmark = pytest.mark.skipif(bool(MISSING), reason=MISSING)


@pytest.fixture
def server(tmp_path):
    with Server(tmp_path / 'logs', os.environ) as made:
        yield made


@pytest.fixture
def bed(server, tmp_path):
    with process_bed(FrankaBed, tmp_path, arm=choice(tmp_path, protocol_server=True)) as made:
        made.start_arm()
        made.wait('the arm', lambda: made.status is not None, 60.0)
        yield made


def recovered(bed, server):
    """End a fault, if there is one, which the robot must have ended; whether there was one."""
    bed.spend(0.5)
    if bed.status.mode != FAULT:
        return False
    assert 'the robot has stopped' in bed.status.reason and server.aborted()
    while not bed.call(Trigger, f'{FRANKA}/recover').success:
        assert 'the robot has stopped' in bed.status.reason  # another pause
    return True


def test_a_motion_that_the_robot_may_end(bed, server, tmp_path):
    try:
        move_joints(bed.client, FRANKA)
    except GdmpError as error:
        assert 'the robot has stopped' in str(error)
        assert recovered(bed, server)
    bed.start_server(skill=str(short_skill(tmp_path)))
    bed.wait_holding()
    recovered(bed, server)
    bed.client.execute()
    result = bed.client.result(60.0)
    if result.error_code != result.SUCCESSFUL:
        assert recovered(bed, server), result.error_string
    assert {bed.children.stop(SERVER), bed.children.stop(FRANKA)} == {0}
    for name in (SERVER, FRANKA):
        assert 'Traceback' not in bed.log(name)


def test_a_server_that_is_killed(bed, server):
    server.kill()
    bed.wait('the fault', lambda: (
        bed.status.mode == FAULT and 'does not answer' in bed.status.reason), 60.0)
    refused = bed.call(Trigger, f'{FRANKA}/recover')
    assert not refused.success and 'does not answer' in refused.message
    assert examine(server.host)[-1].level == BAD
    server.start()
    bed.spend(0.5)
    assert bed.status.mode == FAULT  # nothing begins by itself
    while not bed.call(Trigger, f'{FRANKA}/recover').success:
        assert server.aborted()
    assert bed.children.stop(FRANKA) == 0
    found = {one.subject: one for one in examine(server.host, 2.0)}
    assert set(found) == {'libfranka', 'round trip', 'lost cycles', 'jitter', "the robot's time"}
    assert found['libfranka'].level == GOOD


def test_a_table_under_the_tool_is_felt(tmp_path):
    """The server is tolerant: a machine that pauses ends no motion."""
    arm, table = choice(tmp_path, protocol_server=True), tmp_path / 'table.xml'
    spec = cloth_table(-0.004, arm.model)  # its top is above the tool
    spec.compile()
    table.write_text(spec.to_xml())
    with (Server(tmp_path / 'logs', os.environ, arguments=('--tolerant', '--model', str(table))),
          process_bed(FrankaBed, tmp_path, arm=arm) as bed):
        bed.start_arm()
        move_joints(bed.client, FRANKA)
        bed.wait('the force', lambda: bed.states and bed.states[-1].wrench.force.z > 2.0, 60.0)


@pytest.mark.long
def test_the_letter_with_a_goal_switch(tmp_path):
    try:
        assert run_demo(tmp_path, 'GShape', choice(tmp_path, protocol_server=True)) == 0
    except GdmpError as error:
        assert 'the robot has stopped' in str(error)
        return
    report = json.loads((tmp_path / 'report.json').read_text())
    assert report['arm'] == FRANKA
    assert all(report['limits'].values()), report['limits']


@pytest.mark.long
def test_the_bench_measures_both_clients():
    document = bench.run(timing.TimingSettings(seconds=1.0))
    assert set(document) == {'bare', 'loop'} and len(bench.rows(document)) == 3

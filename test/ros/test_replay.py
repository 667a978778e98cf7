"""Recorded references are sent to the arm again; the arm keeps its rule."""
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from std_srvs.srv import Trigger

from gdmp_ros.data import runs
from gdmp_ros.data.runs import read_references
from gdmp_ros.ros.clients.testbed import ARM, SERVER
from test.commands import gdmp
from test.ros.nodes import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE


@pytest.fixture(scope='module')
def recorded(shared_nodes, tmp_path_factory):
    """A recorded motion; the server is gone, and the arm where the motion began."""
    bag = tmp_path_factory.mktemp('replay') / 'run'
    shared_nodes.record(bag)
    shared_nodes.spend(0.5)
    shared_nodes.client.execute()
    assert shared_nodes.client.result(30.0).error_code == 0
    shared_nodes.spend(0.5)
    run = shared_nodes.recorded(bag)
    shared_nodes.forget()
    return bag, run


def put_server(nodes, active):
    """Let the server be active, or unconfigured."""
    if (nodes.lifecycle_state(SERVER) == 'active') != active:
        assert nodes.transition(SERVER, *((CONFIGURE, ACTIVATE) if active
                                          else (DEACTIVATE, CLEANUP)))


def distance_of(references, path):
    """Largest distance of a reference from a path [m]."""
    return max(np.linalg.norm(path - pose[:3], axis=1).min() for pose in references[::20])


def test_a_replay_while_the_server_publishes_is_refused(shared_nodes, recorded):
    put_server(shared_nodes, active=True)
    done = gdmp('run', recorded[0])
    assert done.returncode == 1
    assert 'trajectory_server publishes on /trajectory_server/reference' in done.stderr


def test_a_replay_far_from_the_robot_moves_nothing(shared_nodes, recorded):
    put_server(shared_nodes, active=False)
    before = len(shared_nodes.robot)
    done = gdmp('run', recorded[0])
    assert done.returncode == 1
    assert 'does not follow: the motion begins' in done.stderr
    assert 'm from the robot' in done.stderr
    shared_nodes.spend(0.3)
    poses = np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z]
                      for m in shared_nodes.robot[before:]])
    assert np.linalg.norm(poses - poses[0], axis=1).max() < 1e-3


def test_a_replay_that_begins_at_the_robot_is_followed_to_its_end(shared_nodes, recorded):
    bag, run = recorded
    put_server(shared_nodes, active=False)
    assert shared_nodes.call(Trigger, f'{ARM}/reset_world').success
    shared_nodes.spend(0.5)
    # The first pose of the arm is the one at which the motion was begun.
    shared_nodes.robot.clear()
    done = gdmp('run', bag)
    assert done.returncode == 0, done.stderr
    assert f'replayed {len(run.references)} references' in done.stdout
    shared_nodes.wait_rest()
    assert np.linalg.norm(shared_nodes.tool()[:3] - run.poses[-1, :3]) < 2e-3
    path = np.array([[m.pose.position.x, m.pose.position.y, m.pose.position.z]
                     for m in shared_nodes.robot])
    # As near to the references as the first time.
    assert distance_of(run.references, path) < distance_of(run.references, run.poses[:, :3]) + 1e-4


def test_a_transition_that_is_not_possible_is_answered(shared_nodes, recorded):
    put_server(shared_nodes, active=False)
    request = ChangeState.Request()
    request.transition.id = DEACTIVATE
    reply = shared_nodes.call(ChangeState, f'{SERVER}/change_state', transition=request.transition)
    assert not reply.success


def test_references_of_a_bag_are_read_with_all_that_they_say(recorded):
    bag, run = recorded
    read = read_references(bag)
    assert read.topic == '/trajectory_server/reference' and read.frame == 'panda_link0'
    np.testing.assert_allclose(read.targets[:, :7], run.references)
    assert [int(mode) for mode in read.modes] == run.modes.tolist()
    assert read.steps[0] == 1 and (read.steps > 0).all()
    assert runs.lost(run) == int((read.steps[1:] - 1).sum())
    done = gdmp('run', bag, '--topic', '/nothing')
    assert done.returncode == 1 and 'expected references on /nothing' in done.stderr

"""Nodes in lockstep, of one test or shared by the tests of a file."""
import pytest

from test.ros.nodes import open_testbed


@pytest.fixture
def nodes(tmp_path, skill_file):
    """A testbed of this test, without nodes."""
    with open_testbed(tmp_path / 'nodes', skill_file) as made:
        yield made


@pytest.fixture(scope='module')
def shared_nodes(tmp_path_factory, skill_file):
    with open_testbed(tmp_path_factory.mktemp('nodes'), skill_file) as made:
        made.start()
        yield made


@pytest.fixture
def running(shared_nodes):
    """Arm and server that the tests of a file share: each finds them as after their start."""
    if shared_nodes.used:
        shared_nodes.restart()
    shared_nodes.used = True
    return shared_nodes

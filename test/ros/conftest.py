"""Skills, and nodes of one test or shared by the tests of a file."""
import pytest

from gdmp_ros.data import lasa
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from test.ros.nodes import open_testbed


@pytest.fixture(scope='session')
def skill():
    """A short skill of pose and stiffness, close to the first pose of the simulated arm."""
    shown = lasa.robot_demonstrations('GShape')[0]
    return Skill.learn(Demonstration(shown.times * (2.0 / shown.duration), shown.points,
                                     shown.manifold))


@pytest.fixture(scope='module')
def skill_file(skill, tmp_path_factory):
    """The skill as a file. A test file that defines `skill` itself gets its own one."""
    path = tmp_path_factory.mktemp('skill') / 'skill.json'
    skill.save(path)
    return path


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

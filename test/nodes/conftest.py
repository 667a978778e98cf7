"""Nodes as processes, each test on a DDS domain of its own, every wait bounded."""
import os

from gdmp_msgs.msg import Reference, RobotState
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
import pytest
from rclpy.node import Node

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data import lasa
from gdmp_ros.ros.lifecycle import PolledGroup, reliable, take
from gdmp_ros.ros.clients.server_client import Operator
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.processes import Children

SERVER, SIM = 'gdmp_ros.ros.server.node', 'gdmp_ros.ros.arm.node'
FRAME = 'panda_link0'
START_UP_S = 60.0


@pytest.fixture(scope='session')
def skill():
    """A short skill of pose and stiffness, close to where the simulated arm stands."""
    shown = lasa.robot_demonstrations('GShape')[0]
    return Skill.learn(Demonstration(shown.times * (2.0 / shown.duration), shown.points,
                                     shown.manifold))


@pytest.fixture(scope='session')
def skill_file(skill, tmp_path_factory):
    path = tmp_path_factory.mktemp('skill') / 'skill.json'
    skill.save(path)
    return path


class World:
    """Processes, and an operator who listens to the robot."""

    def __init__(self, children, skill_file):
        self.children = children
        self.skill_file = skill_file
        self.operator = Operator(check=self._look)
        self.node: Node = self.operator.node
        self.robot: list[RobotState] = []
        self.references: list[Reference] = []
        self._polled = []
        self.collect(RobotState, 'panda_sim/state', self.robot)

    def collect(self, kind, topic, into):
        """Append every message of a fast topic; an executor would fall behind."""
        subscription = self.node.create_subscription(kind, topic, lambda _: None, reliable(2000),
                                                     callback_group=PolledGroup())
        self._polled.append((subscription, into))

    def listen(self):
        """Collect references too."""
        self.collect(Reference, 'trajectory_server/reference', self.references)

    def _look(self):
        self.children.check()
        for subscription, into in self._polled:
            while (message := take(subscription)) is not None:
                into.append(message)

    def start_sim(self, **parameters):
        self.children.start_node('panda_sim', SIM, parameters)

    def start_server(self, name='trajectory_server', **parameters):
        chosen = {'skill': str(self.skill_file),
                  'measured_pose_topic': '/panda_sim/measured_pose', **parameters}
        self.children.start_node(name, SERVER, chosen)

    def start(self):
        """Start both and wait until the server holds the measured pose."""
        self.start_sim()
        self.start_server()
        self.operator.wait_status('holding', START_UP_S)
        self.wait('the robot', lambda: len(self.robot) > 0)

    def wait(self, what, until, timeout=15.0):
        self.operator.wait(what, until, timeout)

    def spin(self, seconds):
        self.operator.spend(seconds)

    def call(self, kind, name, **fields):
        """Call a service and return its reply."""
        return self.operator.call(kind, name, **fields)

    def transition(self, node, number):
        request = ChangeState.Request()
        request.transition.id = number
        return self.call(ChangeState, f'{node}/change_state',
                         transition=request.transition).success

    def lifecycle_state(self, node):
        return self.call(GetState, f'{node}/get_state').current_state.label

    def refusal(self):
        state = self.operator.state
        return state.refused, state.last_refusal

    def log(self, name):
        return self.children.log(name).read_text()

    def tool(self):
        """Measured pose (x, y, z, qw, qx, qy, qz), newest."""
        p, q = self.robot[-1].pose.position, self.robot[-1].pose.orientation
        return np.array([p.x, p.y, p.z, q.w, q.x, q.y, q.z])

    def torques(self):
        return np.array([message.torque for message in self.robot])


@pytest.fixture
def world(tmp_path, skill_file, monkeypatch):
    domain = Domain()
    for key, value in domain.environment().items():
        monkeypatch.setenv(key, value)
    with Children(dict(os.environ), tmp_path / 'logs') as children:
        made = World(children, skill_file)
        try:
            yield made
        finally:
            made.operator.close()
    domain.release()

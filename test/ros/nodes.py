"""Nodes as processes, and the messages that they send; every wait has a timeout."""
from contextlib import contextmanager
import os

from gdmp_msgs.msg import Reference, RobotState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.client import DISCOVERY_S
from gdmp_ros.ros.lifecycle import DEEP, reliable
from gdmp_ros.ros.polling import PolledGroup, take
from gdmp_ros.ros.testbed import ARM, NodeTestbed, SERVER
from gdmp_ros.util.dds_network import Domain

FRAME = 'panda_link0'
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
#: State of a node after a transition.
AFTER = {CONFIGURE: 'inactive', ACTIVATE: 'active', DEACTIVATE: 'inactive',
         CLEANUP: 'unconfigured'}


class Nodes(NodeTestbed):
    """A testbed whose server has a skill, and lists of the messages that were received."""

    def __init__(self, folder, environment, skill_file):
        super().__init__(folder, environment)
        self.skill_file = skill_file
        self.robot: list[RobotState] = []
        self.references: list[Reference] = []
        self._polled = []
        self._made = []
        self._states = {SERVER: 'unconfigured', ARM: 'unconfigured'}
        self.used = False
        self.forget()

    def __exit__(self, *_):
        # Quicker than SIGTERM, whose effect is tested in test_lifecycle.
        for name in list(self.children.processes):
            self.children.kill(name)
        super().__exit__()

    @property
    def node(self):
        """Node of the client, for subscriptions and publishers of a test."""
        return self.client.node

    def check(self):
        super().check()
        for subscription, into in self._polled:
            while (message := take(subscription)) is not None:
                into.append(message)

    def collect(self, kind, topic):
        """List to which all messages of a fast topic are appended; an executor is too slow."""
        into = []
        subscription = self.node.create_subscription(kind, topic, lambda _: None, reliable(DEEP),
                                                     callback_group=PolledGroup())
        self._made.append((self.node.destroy_subscription, subscription))
        self._polled.append((subscription, into))
        return into

    def subscribe(self, kind, topic, callback, quality=None):
        self._made.append((self.node.destroy_subscription, self.node.create_subscription(
            kind, topic, callback, quality or reliable(100))))

    def publisher(self, kind, topic):
        """Publisher that has a subscriber."""
        made = self.node.create_publisher(kind, topic, reliable(10))
        self._made.append((self.node.destroy_publisher, made))
        self.wait(f'a subscriber of {topic}', lambda: made.get_subscription_count() > 0, 60.0)
        return made

    def listen(self):
        """Collect references too."""
        self.references = self.collect(Reference, f'{SERVER}/reference')

    def forget(self):
        """End what a test subscribed to or published; collect states of the arm only."""
        for destroy, made in self._made:
            destroy(made)
        self._made, self._polled, self.references = [], [], []
        self.robot = self.collect(RobotState, f'{ARM}/state')

    def start_server(self, name=SERVER, **parameters):
        super().start_server(name, **{'skill': str(self.skill_file), **parameters})

    def start(self, **parameters):
        """Start arm and server, and wait until the server holds the arm."""
        # Discovered while the nodes start, instead of before the first call.
        clients = {name: self.node.create_client(ChangeState, name)
                   for name in (f'{SERVER}/change_state', f'{ARM}/change_state')}
        super().start(record=False, **parameters)
        for name, client in clients.items():
            self.wait(name, client.service_is_ready)
        self.client._services.update(clients)
        self._states.update({SERVER: 'active', ARM: 'active'})
        self.wait('the arm', lambda: bool(self.robot))

    def restart(self):
        """
        Configure arm and server anew, without new processes; takes a third of a second.

        Afterwards the arm is at its first pose, and skill, goals, tempo and counters are as after
        the start.
        """
        self.unconfigure()
        self.forget()
        for name in (ARM, SERVER):
            assert self.transition(name, CONFIGURE, ACTIVATE)
        self.spend(DISCOVERY_S)
        self.client.state = None
        self.client.wait_status('holding', 30.0)
        self.robot.clear()
        self.wait('the arm', lambda: bool(self.robot))

    def call_later(self, kind, name, **fields):
        """Call a service that `call` has called before; returns the future of the reply."""
        return self.client._services[name].call_async(kind.Request(**fields))

    def unconfigure(self):
        """Deactivate server and arm, and clean them up."""
        for name in (SERVER, ARM):
            if self._states[name] == 'active':
                assert self.transition(name, DEACTIVATE)
            if self._states[name] == 'inactive':
                assert self.transition(name, CLEANUP)

    def set_parameters(self, node, **values):
        """Set parameters atomically; returns the result."""
        changes = [Parameter(name, value=value).to_parameter_msg()
                   for name, value in values.items()]
        return self.call(SetParametersAtomically, f'{node}/set_parameters_atomically',
                         parameters=changes).result

    def transition(self, node, *numbers):
        """Make transitions of the lifecycle; whether all succeeded."""
        for number in numbers:
            request = ChangeState.Request()
            request.transition.id = number
            if not self.call(ChangeState, f'{node}/change_state',
                             transition=request.transition).success:
                return False
            self._states[node] = AFTER[number]
        return True

    def lifecycle_state(self, node):
        return self.call(GetState, f'{node}/get_state').current_state.label

    def tool(self):
        """Newest measured pose (x, y, z, qw, qx, qy, qz)."""
        return messages.pose_numbers(self.robot[-1].pose)

    def torques(self):
        return np.array([message.torque for message in self.robot])

    def wait_quiet(self, received):
        """Wait until no message has been added to a list for 0.3 s."""
        count = -1
        while count != len(received):
            count = len(received)
            self.spend(0.3)

    def wait_rest(self, slower=1e-3):
        """Wait until the arm has been slower than this [m/s] for a quarter of a second."""
        begun = len(self.robot)

        def at_rest():
            recent = self.robot[max(begun, len(self.robot) - 250):]
            return len(recent) == 250 and all(
                np.linalg.norm([m.twist.linear.x, m.twist.linear.y, m.twist.linear.z]) < slower
                for m in recent)
        self.wait('the arm to be at rest', at_rest, 30.0)


@contextmanager
def open_testbed(folder, skill_file):
    """A testbed in a DDS domain of its own; the environment is restored at the end."""
    before = dict(os.environ)
    try:
        with Domain() as domain, Nodes(folder, domain.environment(), skill_file) as made:
            yield made
    finally:
        os.environ.clear()
        os.environ.update(before)

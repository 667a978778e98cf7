"""Nodes, and the messages that they send; every wait has a timeout."""
from contextlib import contextmanager

from gdmp_msgs.action import MoveJoints
from gdmp_msgs.msg import Reference, RobotState
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import numpy as np
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import DISCOVERY_S
from gdmp_ros.ros.clients.testbed import ARM, NodeTestbed, process_bed, SERVER
from gdmp_ros.ros.middleware import latched
from test.lockstep.bed import lockstep_bed
from test.ros.collected import Collected

FRAME = 'panda_link0'
CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
#: State of a node after a transition.
AFTER = {CONFIGURE: 'inactive', ACTIVATE: 'active', DEACTIVATE: 'inactive',
         CLEANUP: 'unconfigured'}


class Nodes(NodeTestbed):
    """A testbed whose server has a skill, and lists of the messages that were received."""

    def __init__(self, folder, skill_file, environment, children=None):
        super().__init__(folder, environment, children=children)
        self.skill_file = skill_file
        self._collected, self._made = [], []
        self._states = {SERVER: 'unconfigured', ARM: 'unconfigured'}
        self.used = False
        self.forget()

    @property
    def participant(self):
        """What tests publish with, and subscribe."""
        return self.client.participant

    def check(self):
        super().check()
        for one in self._collected:
            one.take()

    def collect(self, kind, topic):
        """All messages of a fast topic; callbacks are too slow."""
        made = Collected(self.client, kind, topic)
        self._made.append(made.subscription)
        self._collected.append(made)
        return made

    def subscribe(self, kind, topic, callback, depth=100, late=False):
        """:param late: get the last messages too"""
        self._made.append(
            self.participant.subscription(kind, topic, latched(depth), callback) if late
            else self.client.subscribe(kind, topic, callback, depth))

    def publisher(self, kind, topic, wait=True):
        """:param wait: until it has a subscriber"""
        made = self.client.publisher(kind, topic)
        self._made.append(made)
        if wait:
            self.wait(f'a subscriber of {topic}', lambda: made.subscribers() > 0, 60.0)
        return made

    @contextmanager
    def meanwhile(self, look):
        """
        Call ``look`` every 20 ms, whoever lets time pass, such as a command of this process.

        The messages that have come are received before.
        """
        ended = []

        def looked():
            if ended:
                return True
            self.participant.executor.drain()
            self.check()
            look()
            return False
        self.network.clock.every(20_000_000, looked)
        try:
            yield
        finally:
            ended.append(True)

    def every(self, seconds, callback):
        """Call something periodically while the client waits."""
        self._made.append(self.participant.timer(seconds, callback))

    def listen(self):
        """Collect references too."""
        self.references = self.collect(Reference, f'{SERVER}/reference')

    def forget(self):
        """End what a test subscribed to or published; collect states of the arm only."""
        for made in self._made:
            self.participant.destroy(made)
        self._made, self._collected, self.references = [], [], []
        self.robot = self.collect(RobotState, f'{ARM}/state')

    def start_server(self, name=SERVER, *arguments, **parameters):
        super().start_server(name, *arguments, **{'skill': str(self.skill_file), **parameters})

    def start(self, **parameters):
        """Start arm and server, and wait until the server holds the arm."""
        super().start(record=False, **parameters)
        self._states.update({SERVER: 'active', ARM: 'active'})
        self.wait('the arm', lambda: bool(self.robot))

    def restart(self):
        """
        Configure arm and server anew.

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


def begin_action(bed, kind, name, **fields):
    """Send a goal to an action; returns the `SentGoal` that was accepted."""
    goal = bed.client.send(bed.client.action(kind, name), kind.Goal(**fields), 10.0)
    goal.accepted(10.0)
    return goal


def act(bed, kind, name, **fields):
    """Send a goal to an action; returns the result."""
    return begin_action(bed, kind, name, **fields).result(300.0)


def interrupt_joints(bed, arm, states, name):
    """
    Call a service of an arm while its first joint moves: the motion ends, and says why.

    :param states: of the arm
    :returns: where the joint was then [rad]
    """
    goal = np.array(states[-1].position) + [0.3, 0, 0, 0, 0, 0, 0]
    motion = begin_action(bed, MoveJoints, f'{arm}/move_joints', position=goal.tolist(), speed=0.1)
    bed.wait('a motion', lambda: abs(states[-1].velocity[0]) > 0.05)
    bed.client.service(Trigger, f'{arm}/{name}')  # to find it takes time
    before = states[-1].position[0]
    assert bed.call(Trigger, f'{arm}/{name}').success
    result = motion.result(10.0)
    assert not result.success and f'~/{name}' in result.message
    return before


@contextmanager
def open_testbed(folder, skill_file):
    """A testbed in lockstep."""
    with lockstep_bed(Nodes, folder, skill_file) as made:
        yield made


@contextmanager
def open_processes(folder, skill_file):
    """A testbed of processes in a DDS domain of its own."""
    with process_bed(Nodes, folder, skill_file) as made:
        yield made

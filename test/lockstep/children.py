"""What starts and ends nodes in lockstep; its methods are those of `ChildProcesses`."""
from contextlib import suppress

from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.adapter import Adapter
from gdmp_ros.ros.arm import franka_arm, position_arm, simulated_arm
from gdmp_ros.ros.arm.servo_sim import ServoSim
from gdmp_ros.ros.dds import using
from gdmp_ros.ros.lifecycle import REPORT_S
from gdmp_ros.ros.recorder.node import TakeRecorder
from gdmp_ros.ros.recorder.record import options_of, Recording
from gdmp_ros.ros.server.node import TrajectoryServer
from gdmp_ros.ros.visualizer.node import Visualizer
from gdmp_ros.util.processes import ros_arguments

RECORD = 'gdmp_ros.ros.recorder.record'
#: Nodes by the module that runs them as a process.
NODES = {kind.__module__: kind for kind in (
    Adapter, franka_arm.node, position_arm.node, simulated_arm.node, TakeRecorder,
    ServoSim, TrajectoryServer, Visualizer)}
REPORT_NS = round(1e9 * REPORT_S)


class Log:
    """What a node has logged; read as a file is."""

    def __init__(self):
        self.lines = []

    def read_text(self, **_):
        return ''.join(f'{line}\n' for line in self.lines)


class Child:
    """A node that runs."""

    def __init__(self, network, node):
        self.node, self._network = node, network

        def report():
            if self.node is None:
                return True
            node.participant.executor.call(self._report)
            return False
        network.clock.every(REPORT_NS, report)
        if node.get_parameter('autostart').value:
            node.participant.executor.call(node.autostart)

    def _report(self):
        if self.node is not None:
            self.node.report()

    def stop(self):
        """As Ctrl-C does."""
        self.node.take_down()
        self.kill()

    def kill(self):
        """It does nothing more: neither an end nor a goodbye."""
        node, self.node = self.node, None
        node.participant.clock.kill()
        node.participant.leave()
        node.destroy_node()

    def failure(self):
        return node_failure(self.node)


def node_failure(node):
    """Exception that ended a loop of a node; None if there is none."""
    return next((loop.failure for loop in node.participant.clock.loops
                 if loop.failure is not None), None)


class RecordingChild:
    """The recorder of runs."""

    def __init__(self, network, arguments, log):
        options = options_of(arguments)
        participant = network.client('recorder')
        recording = Recording(participant, options.bag, options.topics, options.best_effort,
                              options.lasting)
        self._participant = participant
        self._running = participant.clock.start(recording.record(log.lines.append))

    def stop(self):
        self._running.end()
        self._participant.leave()

    kill = stop

    def failure(self):
        return self._running.failure


class LockstepChildren:
    """Nodes of one network by name; ``processes`` has those that run."""

    def __init__(self, network, makers=None):
        """:param makers: by module: makes the node instead of its class"""
        self.processes, self._network, self._logs = {}, network, {}
        self._makers = {**NODES, **(makers or {})}

    def start(self, name, module, arguments=(), prefix=(), environment=None):
        log = self._logs.setdefault(name, Log())
        if module == RECORD:
            self.processes[name] = RecordingChild(self._network, arguments, log)
            return
        with using(self._network), self._network.arguments(arguments, log.lines):
            self.processes[name] = Child(self._network, self._makers[module]())

    def start_node(self, name, module, parameters, extra=(), prefix=(), environment=None):
        self.start(name, module, ros_arguments(parameters, extra))

    def node(self, name):
        """The node itself."""
        return self.processes[name].node

    def stop(self, name, timeout=0.0):
        self.processes.pop(name).stop()
        return 0

    def kill(self, name):
        self.processes.pop(name).kill()

    def stop_all(self):
        for name in reversed(list(self.processes)):
            with suppress(Exception):  # what a test broke
                self.stop(name)

    def check(self, may_end=()):
        for name, child in self.processes.items():
            failure = child.failure()
            if failure is not None:
                raise GdmpError(f'a loop of {name} has failed: {failure!r}') from failure

    def log(self, name):
        return self._logs.setdefault(name, Log())

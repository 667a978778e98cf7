"""A testbed with a Franka that keeps what the arm says."""
from contextlib import contextmanager
from functools import partial

from gdmp_msgs.msg import ArmStatus, RobotState
import numpy as np
from std_srvs.srv import Trigger

from gdmp_ros.ros.arm.franka_arm import FrankaArm
from gdmp_ros.ros.arm.franka_gripper import FrankaGripperNode
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm_choice import ArmChoice, FRANKA
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.testbed import NodeTestbed
from gdmp_ros.ros.messages import pose_numbers
from test.franka.stand_in import StandIn
from test.lockstep.bed import lockstep_bed
from test.ros.collected import Collected

HOLD, FOLLOW, FAULT = RobotState.HOLD, RobotState.FOLLOW, RobotState.FAULT

#: Of the joints of the server; `gdmp arm friction` finds it within 2 %.
FRICTION = """\
/**/franka_arm:
  ros__parameters:
    friction_viscous: [0.21]
    friction_dry: [1.137]
"""


class FrankaBed(NodeTestbed):
    """Arm and trajectory server of a Franka, whoever plays the robot."""

    def __init__(self, folder, environment, arm, children=None):
        super().__init__(folder, environment, arm, children)
        self.states, self.status = Collected(self.client, RobotState, f'{FRANKA}/state'), None
        self.client.subscribe(ArmStatus, f'{FRANKA}/status', self._on_status)

    def _on_status(self, message):
        self.status = message

    def wait_mode(self, mode):
        self.wait(f'mode {mode}', lambda: self.status is not None and self.status.mode == mode,
                  60.0)

    def begin(self, skill):
        """Go to the home posture and execute a skill up to 30 % of it."""
        move_joints(self.client, FRANKA)
        self.start_server(skill=str(skill))
        self.wait_holding()
        self.client.execute()
        self.wait_progress(0.3)

    def again(self):
        """Execute the skill from the beginning; whether it reached its goal."""
        self.client.execute()
        result = self.client.result(60.0)
        assert result.error_code == result.SUCCESSFUL, result.error_string

    def still(self, seconds=1.0):
        """Whether the arm does not move [m, within ``seconds``]."""
        self.states.clear()
        self.spend(seconds)
        shown = np.array([pose_numbers(one.pose)[:3] for one in self.states])
        return float(np.linalg.norm(shown - shown[0], axis=1).max())

    def recover(self):
        """End a fault by the service."""
        reply = self.call(Trigger, f'{FRANKA}/recover')
        assert reply.success, reply.message
        self.wait_mode(HOLD)


def makers(robots, network):
    """Nodes of a Franka in lockstep: they control a `StandIn` that is appended to a list."""
    robot = StandIn(network.clock)
    robots.append(robot)
    return {FrankaArm.__module__: lambda: ArmNode(FrankaArm(robot.open)),
            FrankaGripperNode.__module__: lambda: FrankaGripperNode(robot.open_hand)}


@contextmanager
def open_bed(folder):
    """A `FrankaBed` in lockstep; ``robot`` is its `StandIn`."""
    robots = []
    with lockstep_bed(FrankaBed, folder, arm=choice(folder),
                      makers=partial(makers, robots)) as bed:
        bed.robot = robots[0]
        yield bed


def choice(folder, **options):
    """A Franka whose friction is known."""
    friction = folder / 'friction.yaml'
    friction.write_text(FRICTION)
    return ArmChoice('franka', parameter_files=(friction,), **(options or {'host': 'robot'}))

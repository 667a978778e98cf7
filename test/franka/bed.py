"""A testbed with a Franka that keeps what the arm says."""
from gdmp_msgs.msg import ArmStatus, RobotState
import numpy as np

from gdmp_ros.ros.arm_choice import FRANKA
from gdmp_ros.ros.clients.joints_client import move_joints
from gdmp_ros.ros.lifecycle import DEEP, reliable
from gdmp_ros.ros.messages import pose_numbers
from gdmp_ros.ros.testbed import NodeTestbed

#: Of the joints of the server; `gdmp identify-friction` finds it within 2 %.
FRICTION = """\
/**/franka_arm:
  ros__parameters:
    friction_viscous: [0.21]
    friction_dry: [1.137]
"""


class FrankaBed(NodeTestbed):
    """Arm and trajectory server beside a server of the protocol."""

    def __init__(self, folder, environment, choice, server):
        super().__init__(folder, environment, choice)
        self.server, self.states, self.status = server, [], None
        node = self.client.node
        node.create_subscription(RobotState, f'/{FRANKA}/state', self.states.append,
                                 reliable(DEEP))
        node.create_subscription(ArmStatus, f'/{FRANKA}/status', self._on_status, 10)

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

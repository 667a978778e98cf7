"""A gripper that a test tells what to do."""
from gdmp_ros.control.gripper import GripperState


class Hand:
    """A gripper that needs 50 states for a command, and fails if it is told to."""

    def __init__(self):
        self.sent, self.asked, self.fails, self.known = [], 0, '', True
        self.needs, self.before = 50, 0

    def send(self, command):
        self.sent.append(command)
        self.asked = 0

    def state(self):
        self.asked += 1
        done = self.asked > self.needs
        return GripperState(0.0, 0.08, not done, False,
                            len(self.sent) + self.before,
                            self.fails if done else '') if self.known else None

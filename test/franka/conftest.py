"""A stand-in for the robot, and a loop that controls it."""
import pytest

from gdmp_ros.franka.loop import FrankaLoop
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.franka.settings import FrankaSettings
from test.franka.bed import HOLD, open_bed
from test.franka.stand_in import StandIn
from test.lockstep.clock import SteppedClock


@pytest.fixture
def robot():
    return StandIn(SteppedClock())


@pytest.fixture
def loop(robot):
    """A loop that has not begun."""
    access = FrankaRobot(FrankaSettings(host='robot'), robot.clock, robot.open)
    made = FrankaLoop(access, 0.1)
    yield made
    made.end()
    access.close()


@pytest.fixture
def bed(tmp_path):
    """An arm that holds a stand-in of the robot, in lockstep."""
    with open_bed(tmp_path) as made:
        made.start_arm()
        made.wait_mode(HOLD)
        yield made

"""A stand-in for the robot, and a loop that controls it."""
import os

import pytest

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.franka.driver import FrankaDriver
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.franka.settings import FrankaSettings
from test.franka.bed import HOLD, open_bed
from test.franka.stand_in import StandIn
from test.lockstep.clock import SteppedClock


@pytest.fixture(autouse=True)
def _keeps_its_priority():
    """Whatever connects to a robot leaves the priority of its thread as it was."""
    before = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority
    yield
    assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == before


@pytest.fixture
def robot():
    return StandIn(SteppedClock())


@pytest.fixture
def loop(robot):
    """A loop that has not begun."""
    access = FrankaRobot(FrankaSettings(host='robot'), robot.open)
    driver = FrankaDriver(access, 0.1)
    made = ArmControl(driver)
    made.hold(driver.measured)
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

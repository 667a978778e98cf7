"""What the control tests may ask for."""
import pytest

from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.sim import Arm, ClosedLoop


@pytest.fixture
def loop():
    """An arm that has made a tick."""
    made = ClosedLoop(Arm(), ControllerSettings())
    made.tick()
    return made

"""A server of the robot's protocol, and a loop that controls the arm behind it."""
import os

import pytest

from gdmp_ros.errors import DataError
from gdmp_ros.franka import protocol_server
from gdmp_ros.franka.loop import FrankaLoop
from gdmp_ros.franka.robot import FrankaRobot
from gdmp_ros.franka.settings import FrankaSettings
from test.franka.pauses import Pauses
from test.franka.server import Server

try:
    protocol_server.interpreter()
    MISSING = ''
except DataError as error:
    MISSING = str(error)


def pytest_collection_modifyitems(items):
    for item in items:
        if MISSING and item.path.parent.name == 'franka':
            item.add_marker(pytest.mark.skip(reason=MISSING))


@pytest.fixture(scope='module', autouse=True)
def pauses():
    with Pauses() as made:
        yield made


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """At the last try: a robot that stopped because this machine stood still proves nothing."""
    report = yield
    last = getattr(item, 'execution_count', 1) > (item.config.getoption('reruns', 0) or 0)
    bed = item.funcargs.get('bed')
    if report.failed and last and call.when == 'call' and bed is not None:
        longest = max(map(item.funcargs['pauses'].at, bed.server.silent_at()), default=0.0)
        if longest > 0.0:
            report.outcome = 'skipped'
            report.longrepr = (str(item.path), item.location[1],
                               f'Skipped: this machine stood still for {1e3 * longest:.0f} ms '
                               'when the robot stopped')
    return report


@pytest.fixture
def server(tmp_path):
    with Server(tmp_path / 'logs', os.environ) as made:
        yield made


@pytest.fixture
def loop(server):
    """A loop that has not begun."""
    robot = FrankaRobot(FrankaSettings(host='127.0.0.1'))
    made = FrankaLoop(robot, 0.1)
    yield made
    made.end()
    robot.close()

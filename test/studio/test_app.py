"""The studio's thread and the fields of its page, without a browser."""
import asyncio
from types import SimpleNamespace

import pytest
import viser

from gdmp_ros.studio.app import Studio
from gdmp_ros.studio.simulated_robot import SimulatedRobot
from gdmp_ros.studio.teach_panel import TeachPanel
from gdmp_ros.studio.workbench import opened
from test.studio.views import wait


@pytest.fixture
def studio(tmp_path):
    robot, server = SimulatedRobot(), viser.ViserServer('127.0.0.1', 0, verbose=False)
    yield Studio(server, opened([]), robot, '', tmp_path)
    server.stop()
    robot.close()


def enter(studio, work, target, client_id=1):
    """What the page's server does when a user has changed a field."""
    asyncio.run(studio.entered(work)(SimpleNamespace(client_id=client_id, target=target)))


def test_what_the_user_enters_counts_although_the_studio_writes_to_the_field(studio):
    panel = TeachPanel(studio)
    target = SimpleNamespace(value=True)
    enter(studio, panel._guide, target)
    target.value = False  # as when a view of the robot, not guided yet, is shown first
    studio.jobs.take(0.0)()
    assert panel._guided.value
    wait(studio.robot, lambda view: view.mode == 'guided')


def test_what_the_studio_writes_is_no_wish_of_a_user(studio):
    enter(studio, studio.robot.pause, SimpleNamespace(value=True), client_id=None)
    assert studio.jobs.take(0.0) is None

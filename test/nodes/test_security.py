"""Who can reach the nodes, and what the policies allow them."""
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from gdmp_msgs.action import ExecuteSkill
import pytest
from rclpy.action import get_action_server_names_and_types_by_node

from gdmp_ros.errors import GdmpError
from gdmp_ros.util.dds_network import any_machine, CHOSEN, RANGE
from gdmp_ros.experiments.reliability.network import Quality, TwoHosts

ROOT = Path(__file__).parents[2]
#: Beyond what a node has by itself: the launch file's measured pose, and simulated time.
EXTRA = {'trajectory_server': {'/panda_sim/measured_pose', '/clock'}, 'panda_sim': {'/clock'}}


def allowed(node):
    """Topics published and subscribed, services and actions that a policy allows."""
    profile = ElementTree.parse(ROOT / 'config' / 'security' / f'{node}.policy.xml').find(
        f".//enclave[@path='/{node}']/profiles/profile[@node='{node}']")
    assert profile.get('ns') == '/'

    def names(path):
        return {f'/{one.text}' for one in profile.findall(path)}
    return (names("topics[@publish='ALLOW']/topic"), names("topics[@subscribe='ALLOW']/topic"),
            names("services[@reply='ALLOW']/service"), names("actions[@execute='ALLOW']/action"))


def test_policies_allow_what_the_nodes_do_and_nothing_else(world):
    world.start()
    found = world.node

    def known(node):
        """Whether everything about a node has been discovered, as far as anybody can tell."""
        return (node, '/') in found.get_node_names_and_namespaces() and len(
            found.get_service_names_and_types_by_node(node, '/')) >= len(allowed(node)[2])

    for node in ('trajectory_server', 'panda_sim'):
        published, subscribed, replied, executed = allowed(node)
        world.wait(node, lambda node=node: known(node))
        world.spin(0.5)
        actions = {name for name, _ in get_action_server_names_and_types_by_node(
            found, node, '/')}
        assert actions == executed

        def own(pairs):
            return {name for name, _ in pairs if '/_action/' not in name}
        extra = EXTRA[node]
        assert own(found.get_publisher_names_and_types_by_node(node, '/')) | (
            extra & published) == published
        assert own(found.get_subscriber_names_and_types_by_node(node, '/')) | {
            '/trajectory_server/measured_pose'} & subscribed | (extra & subscribed) == subscribed
        assert own(found.get_service_names_and_types_by_node(node, '/')) == replied
        assert own(found.get_client_names_and_types_by_node(node, '/')) == set()
    assert ExecuteSkill  # the action's type is installed


LOOK = ('import rclpy, time\nfrom rclpy.node import Node\nrclpy.init()\nnode = Node("stranger")\n'
        'ends = time.monotonic() + {seconds}\n'
        'while time.monotonic() < ends and "panda_sim" not in node.get_node_names():\n'
        '    time.sleep(0.1)\n'
        'print("panda_sim" in node.get_node_names())')


@pytest.mark.parametrize('chosen, seen', [
    ({}, 'False'), ({RANGE: 'LOCALHOST'}, 'False'), (any_machine({}), 'True')])
def test_only_this_machine_reaches_the_nodes_unless_more_is_asked_for(tmp_path, chosen, seen):
    plain = {key: value for key, value in os.environ.items() if key not in CHOSEN}
    try:
        hosts = TwoHosts(Quality()).__enter__()
    except (GdmpError, OSError) as error:
        pytest.skip(str(error))
    log = (tmp_path / 'log').open('w')
    sim = subprocess.Popen([*hosts.on('robot'), sys.executable, '-m', 'gdmp_ros.ros.arm.node'],
                           env={**plain, **chosen, 'ROS_DOMAIN_ID': '0'}, stdout=log, stderr=log)
    def looked(host, seconds):
        return subprocess.run(
            [*hosts.on(host), sys.executable, '-c', LOOK.format(seconds=seconds)],
            env={**any_machine(os.environ), 'ROS_DOMAIN_ID': '0'},
            capture_output=True, text=True, timeout=90.0).stdout.strip()

    try:
        assert looked('robot', 60.0) == 'True'  # from its own machine it is seen
        assert looked('server', 30.0 if seen == 'True' else 5.0) == seen
        assert sim.poll() is None
    finally:
        sim.terminate()
        sim.wait()
        hosts.__exit__()

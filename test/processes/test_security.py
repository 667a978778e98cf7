"""Which machines reach the nodes, and what the policies allow them."""
from contextlib import ExitStack
import json
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from rclpy.action import get_action_server_names_and_types_by_node

from experiments.reliability.network import Quality, TwoHosts
from gdmp_ros.errors import GdmpError
from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER
from gdmp_ros.util.dds_network import RANGE, REACH, reaching_other_machines, TRANSPORT

ROOT = Path(__file__).parents[2]
#: In addition to what a node has itself: the measured pose of the launch file, simulated time, and
#: the gripper of an arm that has one.
EXTRA = {SERVER: {'/panda_sim/measured_pose', '/clock'},
         ARM: {'/clock', '/gripper/state', '/gripper/command', '/gripper/move',
               '/gripper/gripper_cmd'}}
#: What it subscribes when it is told of something in another frame.
LATER = {SERVER: set(), ARM: {'/tf', '/tf_static'}}


def allowed(node):
    """Topics published and subscribed, services and actions that a policy allows."""
    profile = ElementTree.parse(ROOT / 'config' / 'security' / f'{node}.policy.xml').find(
        f".//enclave[@path='/{node}']/profiles/profile[@node='{node}']")
    assert profile.get('ns') == '/'

    def names(path):
        return {f'/{one.text}' for one in profile.findall(path)}
    return (names("topics[@publish='ALLOW']/topic"), names("topics[@subscribe='ALLOW']/topic"),
            names("services[@reply='ALLOW']/service"), names("actions[@execute='ALLOW']/action"))


def test_policies_allow_what_the_nodes_do_and_nothing_else(nodes):
    nodes.start()
    found = nodes.participant.node

    def known(node):
        """Whether everything about a node has been discovered, as far as one can tell."""
        return (node, '/') in found.get_node_names_and_namespaces() and len(
            found.get_service_names_and_types_by_node(node, '/')) >= len(allowed(node)[2])

    for node in (SERVER, ARM):
        published, subscribed, replied, executed = allowed(node)
        nodes.wait(node, lambda node=node: known(node), 60.0)
        nodes.spend(0.5)
        actions = {name for name, _ in get_action_server_names_and_types_by_node(
            found, node, '/')}
        assert actions | (EXTRA[node] & executed) == executed

        def own(pairs):
            return {name for name, _ in pairs if '/_action/' not in name}
        extra = EXTRA[node]
        assert own(found.get_publisher_names_and_types_by_node(node, '/')) | (
            extra & published) == published
        listens = own(found.get_subscriber_names_and_types_by_node(node, '/'))
        assert listens | LATER[node] | (
            {f'/{SERVER}/measured_pose', *extra} & subscribed) == subscribed
        assert own(found.get_service_names_and_types_by_node(node, '/')) == replied
        assert own(found.get_client_names_and_types_by_node(node, '/')) == set()


#: Prints in which domains there is an arm, 3 s after it has been seen in the given number of them.
LOOK = """
import sys, time
import rclpy
from rclpy.node import Node

def look(domain):
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    return Node('stranger', context=context)

wanted, *domains = map(int, sys.argv[1:])
nodes = {domain: look(domain) for domain in domains}
ends = time.monotonic() + 90.0
def seen():
    return [one for one, node in nodes.items() if 'panda_sim' in node.get_node_names()]
while time.monotonic() < ends and len(seen()) < wanted:
    time.sleep(0.1)
if wanted < len(domains):
    time.sleep(3.0)
print(seen())
"""


@pytest.mark.long
def test_only_this_machine_reaches_the_nodes_by_default(tmp_path):
    plain = {key: value for key, value in os.environ.items() if key not in (*REACH, *TRANSPORT)}
    chosen = [{}, {RANGE: 'LOCALHOST'}, reaching_other_machines({})]
    domains = [str(number) for number in range(len(chosen))]
    with ExitStack() as stack:
        try:
            hosts = stack.enter_context(TwoHosts(Quality()))
        except (GdmpError, OSError) as error:
            pytest.skip(str(error))
        arms = []
        for domain, variables in zip(domains, chosen):
            log = stack.enter_context((tmp_path / domain).open('w'))
            arms.append(subprocess.Popen(
                [*hosts.on('robot'), sys.executable, '-m', MODULES[ARM], '--ros-args', '-p',
                 'autostart:=false'], env={**plain, **variables, 'ROS_DOMAIN_ID': domain},
                stdout=log, stderr=log))
            stack.callback(arms[-1].wait)
            stack.callback(arms[-1].terminate)

        def seen_from(host, count):
            return json.loads(subprocess.run(
                [*hosts.on(host), sys.executable, '-c', LOOK, str(count), *domains],
                env=reaching_other_machines(os.environ), capture_output=True, text=True,
                timeout=180.0, check=True).stdout)

        assert seen_from('robot', 3) == [0, 1, 2]  # all are seen from their own machine
        assert seen_from('server', 1) == [2]
        assert all(arm.poll() is None for arm in arms)

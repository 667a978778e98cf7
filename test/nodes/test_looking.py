"""Layouts, RViz configuration and launch files name what the nodes really have."""
import ast
import configparser
import importlib
import json
from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
import pytest
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray
import yaml

from gdmp_ros.ros.parameter_tables import NODES

ROOT = Path(__file__).parents[2]
FOXGLOVE = json.loads((ROOT / 'config/layouts/foxglove.json').read_text())
RVIZ = yaml.safe_load((ROOT / 'config/gdmp.rviz').read_text())['Visualization Manager']
#: Message types that displays of RViz subscribe to.
DISPLAYS = {'MarkerArray': MarkerArray, 'RobotModel': String, 'Path': PathMessage,
            'Pose': PoseStamped}


@pytest.fixture(scope='module')
def topics(request):
    """All topics of server, arm and visualizer, as they are on the network: name to type."""
    import os

    from gdmp_ros.ros.clients.server_client import Operator
    from gdmp_ros.util.dds_network import Domain
    from gdmp_ros.util.processes import Children
    folder = request.getfixturevalue('tmp_path_factory').mktemp('composed')
    domain = Domain()
    before = dict(os.environ)
    os.environ.update(domain.environment())
    names = ['trajectory_server', 'panda_sim', 'visualizer']
    with Children(dict(os.environ), folder) as children:
        children.start('composed', 'gdmp_ros.ros.composed', [
            *names, '--ros-args', '-p', 'trajectory_server:goal_speed:=0.123'])
        operator = Operator(check=children.check)
        try:
            operator.wait('the nodes', lambda: operator.state is not None, 120.0)
            operator.wait('the visualizer', lambda: '/visualizer/markers' in dict(
                operator.node.get_topic_names_and_types()), 60.0)
            found = dict(operator.node.get_topic_names_and_types())
            nodes = set(operator.node.get_node_names())
            children.stop('composed', timeout=20.0)
        finally:
            operator.close()
    domain.release()
    os.environ.clear()
    os.environ.update(before)
    assert set(names) <= nodes
    return {name: kinds[0] for name, kinds in found.items()}


def message_class(name):
    package, _, kind = name.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), kind)


def resolved(kind, path):
    """Follow a path of fields through a message type; a KeyError where there is none."""
    for word in filter(None, re.split(r'[./]', path)):
        field, _, index = word.partition('[')
        name = kind.get_fields_and_field_types()[field]
        if index:
            size = re.fullmatch(r'(?:sequence<)?([\w/]+)(?:\[(\d+)\]|>)', name)
            assert size.group(2) is None or int(index[:-1]) < int(size.group(2)), path
            name = size.group(1)
        if '/' in name:
            package, plain = name.split('/')
            kind = message_class(f'{package}/msg/{plain}')
        else:
            kind = None
    return kind


def test_every_curve_of_the_foxglove_layout_is_a_number_of_a_message(topics):
    curves = [path['value'] for panel in FOXGLOVE['configById'].values()
              for path in panel.get('paths', ())]
    assert len(curves) > 15
    for curve in curves:
        topic, _, field = curve.partition('.')
        assert resolved(message_class(topics[topic]), field) is None, curve
    assert set(FOXGLOVE['configById']['3D!space']['topics']) <= set(topics)


def test_every_panel_of_the_foxglove_layout_is_placed():
    def leaves(tree):
        if isinstance(tree, str):
            return {tree}
        return leaves(tree['first']) | leaves(tree['second'])
    assert leaves(FOXGLOVE['layout']) == set(FOXGLOVE['configById'])


def test_every_curve_of_the_plotjuggler_layout_is_a_number_of_a_message(topics):
    curves = [curve.get('name') for curve in
              ET.parse(ROOT / 'config/layouts/plotjuggler.xml').iter('curve')]
    assert len(curves) > 10
    for curve in curves:
        topic = next(name for name in topics if curve.startswith(name + '/'))
        assert resolved(message_class(topics[topic]), curve[len(topic):]) is None, curve


def test_rviz_looks_at_topics_of_their_types(topics):
    looked = 0
    for display in RVIZ['Displays']:
        kind = display['Class'].removeprefix('rviz_default_plugins/')
        topic = display.get('Topic') or display.get('Description Topic')
        if topic:
            looked += 1
            found = message_class(topics['/' + topic['Value']])
            assert found is DISPLAYS[kind], topic
    assert looked == 4
    handles = next(d for d in RVIZ['Displays'] if d['Class'].endswith('InteractiveMarkers'))
    space = '/' + handles['Interactive Markers Namespace']
    assert topics[f'{space}/update'] == 'visualization_msgs/msg/InteractiveMarkerUpdate'


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda p: p.name)
def test_launch_files_start_executables_and_name_parameters_that_there_are(path):
    """The files themselves need the launch package, which is not on PyPI: their text is read."""
    tree = ast.parse(path.read_text())
    setup = configparser.ConfigParser()
    setup.read_string('[x]\n' + '\n'.join(re.findall(
        r"'(\w+ = gdmp_ros\.nodes\.\w+:main)'", (ROOT / 'setup.py').read_text())))
    words = {node.value for node in ast.walk(tree)
             if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    if path.name == 'several.launch.py':
        assert any('/launch/arm.launch.py' in word for word in words)
        return
    started = {node.targets[0].slice.value for node in ast.walk(tree)
               if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript)
               and getattr(node.targets[0].value, 'id', '') == 'wanted'}
    assert started == {'panda_sim', 'trajectory_server', 'visualizer'} <= set(setup['x'])
    given = {keyword.value.value for node in ast.walk(tree) if isinstance(node, ast.Call)
             for keyword in node.keywords
             if keyword.arg == 'executable' and isinstance(keyword.value, ast.Constant)}
    assert given == {'composed', 'rviz2'} and 'composed' in setup['x']
    for node in ast.walk(tree):
        # wanted['panda_sim'] = {…}: keys of literal parameters.
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Dict) and isinstance(
                node.targets[0], ast.Subscript):
            known = {spec.name for spec in NODES[node.targets[0].slice.value][1]}
            keys = {key.value for key in node.value.keys if key is not None}
            assert keys <= known | {'use_sim_time'}


def test_composed_refuses_what_it_does_not_know():
    done = subprocess.run([sys.executable, '-m', 'gdmp_ros.ros.composed', 'panda_sim', 'oven'],
                          capture_output=True, text=True)
    assert done.returncode == 2 and "invalid choice: 'oven'" in done.stderr
    twice = subprocess.run([sys.executable, '-m', 'gdmp_ros.ros.composed', 'adapter', 'adapter'],
                           capture_output=True, text=True)
    assert twice.returncode == 2 and 'every node once' in twice.stderr

"""Layouts, RViz configuration and launch files name topics, fields and parameters that exist."""
import ast
import configparser
import importlib
import json
from pathlib import Path
import re
import xml.etree.ElementTree as ET

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
import pytest
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray
import yaml

from gdmp_ros.ros import composed
from gdmp_ros.ros.clients.testbed import ARM, MODULES, SERVER
from gdmp_ros.ros.middleware import Publisher, Subscription
from gdmp_ros.ros.parameter_tables import NODES
from test.ros.nodes import open_testbed

ROOT = Path(__file__).parents[2]
FOXGLOVE = json.loads((ROOT / 'config/layouts/foxglove.json').read_text())
RVIZ = yaml.safe_load((ROOT / 'config/gdmp.rviz').read_text())['Visualization Manager']
#: Message types that displays of RViz subscribe to.
DISPLAYS = {'MarkerArray': MarkerArray, 'RobotModel': String, 'Path': PathMessage,
            'Pose': PoseStamped}


@pytest.fixture(scope='module')
def topics(tmp_path_factory):
    """All topics of server, arm and visualizer: name to type."""
    with open_testbed(tmp_path_factory.mktemp('nodes'), '') as nodes:
        for name in (SERVER, ARM):
            nodes.children.start_node(name, MODULES[name], {})
        nodes.children.start_node('visualizer', 'gdmp_ros.ros.visualizer.node', {})
        nodes.wait('the server', lambda: nodes.client.state is not None)
        return {one.topic: type_name(one.kind)
                for name in (SERVER, ARM, 'visualizer')
                for one in nodes.children.node(name).participant.made
                if isinstance(one, (Publisher, Subscription))}


def type_name(kind):
    return f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'


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


def test_rviz_displays_topics_of_their_types(topics):
    displays = 0
    for display in RVIZ['Displays']:
        kind = display['Class'].removeprefix('rviz_default_plugins/')
        topic = display.get('Topic') or display.get('Description Topic')
        if topic:
            displays += 1
            found = message_class(topics['/' + topic['Value']])
            assert found is DISPLAYS[kind], topic
    assert displays == 4
    handles = next(d for d in RVIZ['Displays'] if d['Class'].endswith('InteractiveMarkers'))
    space = '/' + handles['Interactive Markers Namespace']
    assert topics[f'{space}/update'] == 'visualization_msgs/msg/InteractiveMarkerUpdate'


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda p: p.name)
def test_launch_files_start_executables_and_set_parameters_that_exist(path):
    """The text is checked: the package launch is not on PyPI."""
    tree = ast.parse(path.read_text())
    setup = configparser.ConfigParser()
    setup.read_string('[x]\n' + '\n'.join(re.findall(
        r"'(\w+ = gdmp_ros\.ros\.[\w.]+:main)'", (ROOT / 'setup.py').read_text())))
    words = {node.value for node in ast.walk(tree)
             if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    if path.name == 'several.launch.py':
        assert any('/launch/arm.launch.py' in word for word in words)
        return
    if path.name == 'two_arms.launch.py':
        names = {key.value for node in ast.walk(tree) if isinstance(node, ast.Dict)
                 for key in node.keys if isinstance(key, ast.Constant)}
        known = {spec.name for name in ('panda_sim', 'trajectory_server')
                 for spec in NODES[name][1]}
        assert 'second_frame_id' in names and names <= known
        assert {'panda_sim', 'trajectory_server'} <= words & set(setup['x'])
        return
    started = {node.targets[0].slice.value for node in ast.walk(tree)
               if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript)
               and getattr(node.targets[0].value, 'id', '') == 'wanted'}
    assert started == {'panda_sim', 'franka_arm', 'franka_gripper', 'trajectory_server',
                       'visualizer'}
    assert started <= set(setup['x'])
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


@pytest.mark.parametrize('names, reason', [
    (['panda_sim', 'oven'], "invalid choice: 'oven'"),
    (['adapter', 'adapter'], 'every node must occur once'),
    (['franka_arm', 'trajectory_server'], 'franka_arm needs a process of its own')])
def test_composed_refuses_unknown_and_repeated_nodes(capsys, names, reason):
    with pytest.raises(SystemExit) as ended:
        composed.main(names)
    assert ended.value.code == 2 and reason in capsys.readouterr().err

"""
Rules of the structure that no linter knows.

The order of the packages and cycles: import-linter (setup.cfg). Private names: ruff.
"""
import ast
import importlib
from pathlib import Path
import re
import subprocess
import sys

from gdmp_ros.cli.main import PROGRAM

PACKAGE = Path(__file__).parent.parent / 'gdmp_ros'
#: Rooms that may import a library.
ONLY_IN = {'rclpy': {'ros'}, 'mujoco': {'sim'}, 'pylibfranka': {'franka'},
           'matplotlib': {'view', 'demo'}, 'rosbags': {'data', 'ros'},
           'numba': {'kernels'}, 'plotly': {'view'}, 'viser': {'studio'}}
#: Files that import by a string: from a list of the package, or outside of it.
LISTS = {
    'gdmp_ros.cli.program': [f'gdmp_ros.cli.{name.replace(" ", "_")}' for name in PROGRAM.verbs],
    'gdmp_ros.ros.gripper': [], 'gdmp_ros.ros.recorder.record': [],
    'gdmp_ros.ros.scene.moveit': [], 'gdmp_ros.sim.model_sources': [],
}


def name_of(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix('').parts
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)


TREES = {name_of(path): ast.parse(path.read_text()) for path in sorted(PACKAGE.rglob('*.py'))}


def runtime_nodes(tree):
    """All nodes of a file but for those under ``if TYPE_CHECKING``."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and 'TYPE_CHECKING' in ast.dump(node.test):
            continue
        yield node
        yield from runtime_nodes(node)


def imported(tree):
    """Modules that a file imports, inside of functions too; relative ones begin with a dot."""
    for node in runtime_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = '.' * node.level + (node.module or '')
            for alias in node.names:
                yield f'{base}.{alias.name}' if f'{base}.{alias.name}' in TREES else base


def package(module):
    return module.split('.')[1] if '.' in module else 'facade'


def test_the_package_itself_is_imported_for_its_version_only():
    for name, tree in TREES.items():
        for node in runtime_nodes(tree):
            if isinstance(node, ast.ImportFrom) and node.module == 'gdmp_ros':
                for alias in node.names:
                    assert (alias.name == '__version__'
                            or f'gdmp_ros.{alias.name}' in TREES), f'{name}: {alias.name}'


def test_imports_by_string_come_from_the_lists():
    found = {name for name, tree in TREES.items() for node in ast.walk(tree)
             if isinstance(node, ast.Call)
             and ast.unparse(node.func) in ('importlib.import_module', 'import_module',
                                            '__import__')}
    assert found == set(LISTS)
    for modules in LISTS.values():
        for module in modules:
            assert module in TREES


def test_libraries_are_imported_in_their_packages():
    wrong = [f'{name} imports {module}' for name, tree in TREES.items()
             for module in imported(tree)
             if package(name) not in ONLY_IN.get(module.split('.')[0], {package(name)})]
    assert not wrong


def test_time_comes_from_the_clock_that_is_handed_in():
    """Nodes, streams and control laws read and wait for `gdmp_ros.realtime.loop.Clock` only."""
    wrong = {name for name, tree in TREES.items()
             if package(name) in ('ros', 'playback', 'control')
             and {'time', 'datetime'} & {module.split('.')[0] for module in imported(tree)}}
    assert not wrong


def test_nodes_reach_dds_through_the_middleware():
    """What publishes, takes, serves, calls or waits in `rclpy` is in one file."""
    reached = [f'{name}: {text}' for name, tree in TREES.items() if name != 'gdmp_ros.ros.dds'
               for text in [*imported(tree), *called(tree)] if re.fullmatch(
                   r'rclpy\.(action|executors|timer|publisher|subscription|service|client)(\..*)?'
                   r'|.*\.create_(publisher|subscription|service|client|timer|rate)'
                   r'|rclpy\.spin\w*', text)]
    # rclpy's own subscription to /clock, which a node makes when it begins to use it.
    assert reached == ['gdmp_ros.ros.lifecycle: super().create_subscription']


def called(tree):
    """What a file calls, as it is written."""
    return [ast.unparse(node.func) for node in ast.walk(tree) if isinstance(node, ast.Call)]


def test_the_library_works_without_ros_and_without_mujoco():
    code = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('rclpy', 'mujoco', 'gdmp_msgs', 'std_msgs'):
            raise ImportError(name)
sys.meta_path.insert(0, Blocked())
import importlib
import numpy as np
import gdmp_ros
from gdmp_ros.cli.main import PROGRAM
from gdmp_ros.control import controller
from gdmp_ros.data import bags, lasa, recordings
PROGRAM.parse(['learn', 'bag', '-o', 'skill.json'])
t = np.linspace(0, 1, 50)
skill = gdmp_ros.Skill.learn(gdmp_ros.Demonstration(t, t[:, None] ** 2, gdmp_ros.Euclidean(1)))
assert abs(skill.reproduce(0.1).points[-1, 0] - 1) < 1e-2
assert set(gdmp_ros.__all__) <= set(dir(gdmp_ros))
"""
    subprocess.run([sys.executable, '-c', code], check=True)


def test_every_verb_has_a_module_that_can_be_parsed_and_run():
    for name in PROGRAM.verbs:
        module = importlib.import_module(f'gdmp_ros.cli.{name.replace(" ", "_")}')
        assert module.__doc__ and callable(module.add_arguments) and callable(module.run)

"""Which file imports which, what is private, and what works without ROS and without MuJoCo."""
import ast
import importlib
from pathlib import Path
import subprocess
import sys

import pytest

from gdmp_ros.cli.main import PROGRAM

PACKAGE = Path(__file__).parent.parent / 'gdmp_ros'
#: A room may import from itself and from rooms before it.
ROOMS = ('errors', 'choices', 'kernels', 'util', 'manifolds', 'dmp', 'learning', 'control',
         'realtime', 'playback', 'data', 'sim', 'franka', 'improvement',
         'view', 'ros', 'studio', 'demo', 'cli')
#: Facade methods: they import from a later room when they are called (docs/design.md).
FACADES = {('gdmp_ros.dmp.skill', 'gdmp_ros.learning.fit')}
#: Rooms that may import a library.
ONLY_IN = {'rclpy': {'ros'}, 'mujoco': {'sim'}, 'pylibfranka': {'franka'},
           'matplotlib': {'view', 'demo'}, 'rosbags': {'data', 'ros'},
           'numba': {'kernels'}, 'plotly': {'view'}, 'viser': {'studio'}}
#: Files that import by a string: from a list of the package, or outside of it.
LISTS = {
    'gdmp_ros.cli.program': [f'gdmp_ros.cli.{name.replace("-", "_")}' for name in PROGRAM.verbs],
    'gdmp_ros.ros.recorder.record': [], 'gdmp_ros.sim.model_sources': [],
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


def room(module):
    return module.split('.')[1] if '.' in module else 'facade'


#: Modules of the package that each file imports.
GRAPH = {name: {other for other in imported(tree) if other in TREES and other != name}
         | set(LISTS.get(name, ())) for name, tree in TREES.items()}
del GRAPH['gdmp_ros']  # its names are imported when they are used: it is above all rooms


def test_imports_have_no_cycle():
    finished, path = set(), []

    def visit(name):
        assert name not in path, ' -> '.join([*path[path.index(name):], name])
        if name in finished:
            return
        path.append(name)
        for other in sorted(GRAPH.get(name, ())):
            if (name, other) not in FACADES and not (other == 'gdmp_ros' or name == other):
                visit(other)
        path.pop()
        finished.add(name)
    for name in GRAPH:
        visit(name)


def test_rooms_depend_on_earlier_rooms_only():
    assert {room(name) for name in GRAPH} == set(ROOMS)
    wrong = [f'{name} imports {other}' for name, others in GRAPH.items() for other in others
             if other != 'gdmp_ros' and (name, other) not in FACADES
             and ROOMS.index(room(other)) > ROOMS.index(room(name))]
    assert not wrong


def test_every_facade_is_used_and_named_in_the_design():
    design = (PACKAGE.parent / 'docs' / 'design.md').read_text()
    for name, other in FACADES:
        assert other in GRAPH[name] and other in design


def test_the_package_itself_is_imported_for_its_version_only():
    for name, tree in TREES.items():
        for node in runtime_nodes(tree):
            if isinstance(node, ast.ImportFrom) and node.module == 'gdmp_ros':
                for alias in node.names:
                    assert (alias.name == '__version__'
                            or f'gdmp_ros.{alias.name}' in TREES), f'{name}: {alias.name}'


def test_no_import_is_relative():
    assert not [name for name, tree in TREES.items()
                if any(module.startswith('.') for module in imported(tree))]


def test_imports_by_string_come_from_the_lists():
    found = {name for name, tree in TREES.items() for node in ast.walk(tree)
             if isinstance(node, ast.Call)
             and ast.unparse(node.func) in ('importlib.import_module', 'import_module',
                                            '__import__')}
    assert found == set(LISTS)
    for modules in LISTS.values():
        for module in modules:
            assert module in TREES


def test_libraries_are_imported_in_their_rooms():
    wrong = [f'{name} imports {module}' for name, tree in TREES.items()
             for module in imported(tree)
             if room(name) not in ONLY_IN.get(module.split('.')[0], {room(name)})]
    assert not wrong


def private(name):
    return name.startswith('_') and not name.startswith('__')


def own_names(tree):
    """Private names that a file defines itself: functions, fields, attributes of ``self``."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            yield node.name
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) \
                and ast.unparse(node.value) in ('self', 'cls'):
            yield node.attr
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value  # __slots__


def reaches(name):
    """Private names of other modules that a file uses."""
    tree = TREES[name]
    own = set(own_names(tree))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith('gdmp_ros'):
            yield from (alias.name for alias in node.names if private(alias.name))
        elif isinstance(node, ast.Attribute) and private(node.attr) and node.attr not in own \
                and ast.unparse(node.value) not in ('self', 'cls', 'super()'):
            yield ast.unparse(node)


#: Private names of libraries that have no public one.
LIBRARIES = {
    'gdmp_ros.kernels.compile': {'compiled._cache'},
    'gdmp_ros.kernels.intrinsics': {'made._getvalue'},
    'gdmp_ros.ros.running': {'os._exit'},
}


@pytest.mark.parametrize('name', TREES)
def test_no_module_uses_private_names_of_another(name):
    # Methods of named tuples are public, in spite of their names.
    found = {text for text in reaches(name)
             if text.rpartition('.')[2] not in ('_asdict', '_replace', '_fields', '_make')}
    assert found <= LIBRARIES.get(name, set())


def test_files_are_short():
    long = {str(path): lines for path in PACKAGE.rglob('*.py')
            if (lines := len(path.read_text().splitlines())) >= 300}
    assert not long


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
"""
    subprocess.run([sys.executable, '-c', code], check=True)


def test_every_verb_has_a_module_that_can_be_parsed_and_run():
    for name in PROGRAM.verbs:
        module = importlib.import_module(f'gdmp_ros.cli.{name.replace("-", "_")}')
        assert module.__doc__ and callable(module.add_arguments) and callable(module.run)

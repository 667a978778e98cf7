"""Which way dependence runs, and what works without ROS and without MuJoCo."""
import ast
import math
from pathlib import Path
import subprocess
import sys

import pytest

PACKAGE = Path(__file__).parent.parent / 'gdmp_ros'
#: Lower may not import higher; folders on one level may import each other as listed below.
LEVELS = {'errors': 0, 'compilation': 0, 'terminal': 0, 'writing': 0, 'profiles': 0, 'needs': 1,
          'parallel': 1, 'manifolds': 1, 'dmp': 2, 'stiffness': 3, 'control': 3, 'files': 4,
          'sim': 4, 'realtime': 4, 'plots': 4, 'tuning': 4, 'nodes': 5, 'bench': 5, 'cli': 5,
          'demo': 6, 'paper': 5, 'report': 5, 'reliability': 6}
ONLY_IN = {'rclpy': ('nodes', 'demo', 'reliability'), 'mujoco': ('sim',),
           'matplotlib': ('plots', 'demo'), 'rosbags': ('files', 'nodes'),
           'numba': ('compilation',), 'plotly': ('report',)}


def imports(path):
    """Modules a file imports, with whether the import is at module level."""
    tree = ast.parse(path.read_text())
    top = {id(node) for node in tree.body}
    guarded = {id(inner) for node in tree.body if isinstance(node, ast.If)
               and 'TYPE_CHECKING' in ast.dump(node.test) for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) in guarded:
            continue
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, id(node) in top
        elif isinstance(node, ast.ImportFrom):
            yield node.module, id(node) in top


def home(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix('.py')


FILES = sorted(p for p in PACKAGE.rglob('*.py') if p.parent != PACKAGE or p.stem != '__init__')


@pytest.mark.parametrize('path', FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_dependence_runs_one_way(path):
    here = home(path)
    for module, at_top in imports(path):
        parts = module.split('.')
        if parts[0] == 'gdmp_ros' and len(parts) > 1 and at_top:
            other = parts[1]
            assert other == here or LEVELS[other] <= LEVELS[here], f'{path} imports {module}'
            assert not (here in ('cli', 'paper') and other == 'nodes'), f'{path}: {module}'
        if parts[0] in ONLY_IN:
            assert here in ONLY_IN[parts[0]], f'{path} imports {module}'


def test_the_library_works_without_ros_and_without_mujoco():
    code = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in ('rclpy', 'mujoco', 'gdmp_msgs', 'std_msgs'):
            raise ImportError(name)
sys.meta_path.insert(0, Blocked())
import numpy as np
import gdmp_ros
from gdmp_ros.cli.main import parser
from gdmp_ros.data import bags
from gdmp_ros.data import lasa
from gdmp_ros.data import recordings
from gdmp_ros.control import impedance
parser()
t = np.linspace(0, 1, 50)
skill = gdmp_ros.Skill.learn(gdmp_ros.Demonstration(t, t[:, None] ** 2, gdmp_ros.Euclidean(1)))
assert abs(skill.reproduce(0.1).points[-1, 0] - 1) < 1e-2
"""
    subprocess.run([sys.executable, '-c', code], check=True)


def test_an_edited_kernel_is_never_served_from_the_cache(tmp_path):
    """The cache is stamped with all kernel sources, not with the caller's file alone."""
    import shutil
    copy = tmp_path / 'gdmp_ros'
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns('__pycache__'))
    code = ('import numpy as np;'
            'from gdmp_ros.manifolds import UnitQuaternion;'
            'print(UnitQuaternion().exp(np.eye(4)[0], np.array([0.1, 0, 0]))[1])')
    environment = {'PYTHONPATH': str(tmp_path), 'GDMP_CACHE': str(tmp_path / 'cache'),
                   'PATH': '/usr/bin:/bin', 'HOME': str(tmp_path)}

    def value():
        return float(subprocess.run([sys.executable, '-c', code], env=environment, check=True,
                                    capture_output=True, text=True, cwd=tmp_path).stdout)

    assert value() == value() == pytest.approx(math.sin(0.1))
    path = copy / 'manifolds' / 'linalg.py'  # called by the kernel in quaternion.py
    path.write_text(path.read_text().replace('return math.sin(angle) / angle',
                                             'return 2.0 * math.sin(angle) / angle'))
    assert value() == pytest.approx(2.0 * math.sin(0.1), rel=0.02)


def test_a_new_process_steps_from_the_cache_without_compiling():
    code = ('import numpy as np, gdmp_ros;'
            'from gdmp_ros.dmp import stepping;'
            't = np.linspace(0, 1, 400);'
            'shown = gdmp_ros.Demonstration(t, t[:, None] ** 3, gdmp_ros.Euclidean(1));'
            'gdmp_ros.Rollout(gdmp_ros.Skill.learn(shown)).advance(1e-3);'
            'print(len(stepping.advance.stats.cache_misses))')
    runs = [subprocess.run([sys.executable, '-c', code], check=True, capture_output=True,
                           text=True).stdout.strip() for _ in range(2)]
    assert runs[1] == '0'


def test_every_file_with_kernels_stamps_the_cache():
    from gdmp_ros.compilation import KERNEL_SOURCES
    stamped = {path for pattern in KERNEL_SOURCES for path in PACKAGE.glob(pattern)}
    for path in FILES:
        if 'from gdmp_ros.compilation import' in path.read_text():
            assert path in stamped, path

"""Compiled kernels are kept on disk, and compiled again when their code has changed."""
from concurrent.futures import ThreadPoolExecutor
import importlib
import math
import os
from pathlib import Path
import pickle
import pkgutil
import shutil
import subprocess
import sys
import tempfile
import time
from types import ModuleType

from numba.core.dispatcher import Dispatcher
import pytest

import gdmp_ros
from gdmp_ros.kernels import allocating, cache, cache_folder, is_warm, on_compile, remove_stale

PACKAGE = Path(gdmp_ros.__file__).parent

SOURCE = """
SCALE = 2.0

@kernel
def inner(x):
    return SCALE * x

@kernel
def outer(x):
    '''Scale a number.'''
    y = [3.0 * inner(x) for _ in range(1)]
    return y[0] + 1.0
"""


def outer_of(text, module='example'):
    """The kernel ``outer`` of a module with this text."""
    names = {'kernel': allocating, '__name__': f'gdmp_ros.{module}'}
    exec(compile(text, 'example.py', 'exec'), names)
    return names['outer']


def hash_of(text):
    return cache.code_hash(outer_of(text).py_func)


@pytest.mark.parametrize('old, new', [
    ('SCALE = 2.0', '# A comment.\n\nSCALE = 2.0  # another'),
    ('Scale a number.', 'Multiply a number.\n\n    And add one.\n    '),
    ('return SCALE * x', 'return (SCALE *\n            x)')])
def test_text_that_is_not_code_does_not_change_the_hash(old, new):
    assert old in SOURCE
    assert hash_of(SOURCE.replace(old, new)) == hash_of(SOURCE)


@pytest.mark.parametrize('old, new', [
    ('SCALE = 2.0', 'SCALE = 2.5'),
    ('SCALE * x', 'SCALE + x'),
    ('+ 1.0', '+ 1.5'),
    ('3.0 * inner', '3.5 * inner'),
    ('inner(x) for', 'inner(-x) for')])
def test_an_edit_of_a_kernel_or_of_what_it_uses_changes_the_hash(old, new):
    assert old in SOURCE
    assert hash_of(SOURCE.replace(old, new)) != hash_of(SOURCE)


def test_the_hash_of_a_kernel_changes_when_one_that_it_calls_moves():
    """Its machine code names the module: it cannot be loaded when there is no such module."""
    inner, moved = (outer_of(SOURCE, module).py_func.__globals__['inner']
                    for module in ('here', 'there'))
    outer = outer_of(SOURCE)
    hashes = set()
    for called in (inner, moved):
        outer.py_func.__globals__['inner'] = called
        hashes.add(cache.code_hash(outer.py_func))
    assert len(hashes) == 2


def kernels():
    """Python functions of all kernels of the library."""
    found = {}
    for name in ('gdmp_ros.manifolds', 'gdmp_ros.dmp', 'gdmp_ros.control', 'gdmp_ros.realtime',
                 'gdmp_ros.playback', 'gdmp_ros.sim', 'gdmp_ros.ros', 'gdmp_ros.ros.arm',
                 'gdmp_ros.ros.server', 'experiments.baselines'):
        package = importlib.import_module(name)
        for one in pkgutil.iter_modules(package.__path__, f'{package.__name__}.'):
            found.update((id(value), value.py_func) for value
                         in vars(importlib.import_module(one.name)).values()
                         if isinstance(value, Dispatcher))
    return list(found.values())


def test_kernels_use_nothing_that_the_hash_does_not_contain():
    """Names inside modules of this package, and default values of arguments."""
    assert len(kernels()) > 100
    for function in kernels():
        used = [function.__globals__.get(name)
                for name in cache._global_names(function.__code__)]
        names = [value.__name__ for value in used if isinstance(value, ModuleType)]
        assert not any(name.startswith('gdmp_ros') for name in names), (function, names)
        assert function.__defaults__ is None and function.__kwdefaults__ is None, function


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv('GDMP_CACHE', str(tmp_path / 'cache'))
    return tmp_path / 'cache'


def compiled_by(text, expected):
    """Names of the kernels that are compiled by a call of ``outer(1.0)``."""
    started, finished = [], []
    with on_compile(started.append, lambda: finished.append(None)):
        assert outer_of(text)(1.0) == expected
    assert len(finished) == len(started)
    return started


def test_kernels_are_compiled_once_and_again_after_an_edit(folder):
    assert not is_warm()
    assert compiled_by(SOURCE, 7.0) == ['example.outer', 'example.inner']
    assert is_warm()
    assert compiled_by(SOURCE.replace('Scale', 'Multiply'), 7.0) == []
    assert compiled_by(SOURCE.replace('+ 1.0', '+ 2.0'), 8.0) == ['example.outer']
    # Both kernels use the constant. The first text is still kept.
    assert len(compiled_by(SOURCE.replace('2.0', '4.0'), 13.0)) == 2
    assert compiled_by(SOURCE, 7.0) == []


def test_an_index_that_names_a_type_which_was_moved_is_forgotten(folder):
    compiled_by(SOURCE, 7.0)
    for path in (cache_folder() / 'gdmp_ros.example').glob('*.nbi'):
        # Its first record is the version of Numba; the second cannot be read.
        version = pickle.dumps(pickle.loads(path.read_bytes()))
        path.write_bytes(version + b'cgdmp_ros.kernels\nNoLongerHere\n.')
    assert compiled_by(SOURCE, 7.0) == ['example.outer', 'example.inner']
    assert compiled_by(SOURCE, 7.0) == []


def test_the_newest_versions_of_a_kernel_are_kept(folder):
    for number in range(cache._KEPT_VERSIONS + 2):
        compiled_by(SOURCE.replace('+ 1.0', f'+ {number}.5'), 6.5 + number)
    versions = list((cache_folder() / 'gdmp_ros.example').glob('example.outer-*.nbi'))
    assert len(versions) == cache._KEPT_VERSIONS
    assert compiled_by(SOURCE.replace('+ 1.0', f'+ {number}.5'), 6.5 + number) == []
    assert compiled_by(SOURCE.replace('+ 1.0', '+ 0.5'), 6.5) == ['example.outer']


def test_several_may_remove_older_versions_at_once(folder):
    compiled_by(SOURCE, 7.0)
    kept = cache_folder() / 'gdmp_ros.example'
    caches = [cache.KernelCache(outer_of(SOURCE).py_func) for _ in range(4)]

    def remove(one):
        for number in range(100):
            for version in range(8):
                (kept / f'example.outer-{version}.{number}.nbi').touch()
            one._remove_older()
    with ThreadPoolExecutor(len(caches)) as pool:
        list(pool.map(remove, caches))
    caches[0]._remove_older()
    # What another one has just removed does not count: fewer may stay, but never none.
    assert 1 <= len(list(kept.glob('example.outer-*.nbi'))) <= cache._KEPT_VERSIONS


def test_caches_of_older_versions_are_removed(folder):
    current = cache_folder()
    names = {'numba-0.1-cpython-39': True, 'numba-0.2-cpython-310': False, 'notes': False}
    for name in names:
        (folder / name / 'module').mkdir(parents=True)
        (folder / name / 'module' / 'kernel.nbi').touch()
    (folder / 'numba-file').touch()
    old = time.time() - 86400.0 * (cache._STALE_DAYS + 1.0)
    for name in ('numba-0.1-cpython-39', 'notes', current.name):
        os.utime(folder / name, (old, old))
    remove_stale()
    kept = {name for name, removed in names.items() if not removed}
    assert {path.name for path in folder.iterdir()} == {*kept, current.name, 'numba-file'}
    assert (folder / 'notes' / 'module' / 'kernel.nbi').exists()


def test_without_a_writable_folder_a_temporary_one_is_used(tmp_path, monkeypatch):
    (tmp_path / 'file').touch()
    monkeypatch.setenv('GDMP_CACHE', str(tmp_path / 'file' / 'cache'))
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    assert cache_folder().parent.parent == tmp_path and cache_folder().is_dir()


def output_of(code, cwd=None, **environment):
    return subprocess.run([sys.executable, '-c', code], check=True, capture_output=True, text=True,
                          cwd=cwd, env={**os.environ, **environment}).stdout.split()


def test_an_edit_in_another_file_of_the_package_is_noticed(tmp_path):
    copy = tmp_path / 'gdmp_ros'
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns('__pycache__'))
    code = ('import numpy as np\n'
            'from gdmp_ros.kernels import on_compile\n'
            'from gdmp_ros.manifolds import UnitQuaternion\n'
            'names = []\n'
            'with on_compile(names.append, lambda: None):\n'
            '    print(UnitQuaternion().exp(np.eye(4)[0], np.array([0.1, 0, 0]))[1])\n'
            'print(len(names))')

    def run():
        value, compiled = output_of(code, tmp_path, PYTHONPATH=str(tmp_path),
                                    GDMP_CACHE=str(tmp_path / 'cache'))
        return float(value), int(compiled)

    value, compiled = run()
    assert value == pytest.approx(math.sin(0.1)) and compiled > 0
    assert run() == (value, 0)
    # A kernel of quaternion.py calls this one of linalg.py.
    path = copy / 'manifolds' / 'linalg.py'
    text, line = path.read_text(), 'return math.sin(angle) / angle'
    assert line in text
    path.write_text(text.replace(line, f'# A comment.\n    {line}'))
    assert run() == (value, 0)
    path.write_text(text.replace(line, 'return 2.0 * math.sin(angle) / angle'))
    value, compiled = run()
    assert value == pytest.approx(2.0 * math.sin(0.1), rel=0.02) and compiled > 0


def test_a_new_process_steps_from_the_cache_without_compiling():
    code = ('import numpy as np, gdmp_ros\n'
            'from gdmp_ros.dmp import integrator\n'
            'from gdmp_ros.kernels import on_compile\n'
            'names = []\n'
            't = np.linspace(0, 1, 400)\n'
            'with on_compile(names.append, lambda: None):\n'
            '    shown = gdmp_ros.Demonstration(t, t[:, None] ** 3, gdmp_ros.Euclidean(1))\n'
            '    gdmp_ros.Rollout(gdmp_ros.Skill.learn(shown)).advance(1e-3)\n'
            'print(len(integrator.advance.stats.cache_misses), *names)')
    # Sets and dictionaries of strings have another order in each of the two.
    runs = [output_of(code, PYTHONHASHSEED=seed) for seed in '01']
    assert runs[1] == ['0']

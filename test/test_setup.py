"""Errors and progress of the set-up; generated files agree with the code."""
import ast
import importlib.util
import os
from pathlib import Path
import re
import subprocess
import sys

import pytest
import yaml

ROOT = Path(__file__).parent.parent
BOOTSTRAP = ROOT / '.ci' / 'bootstrap.py'


@pytest.fixture
def bootstrap(monkeypatch):
    spec = importlib.util.spec_from_file_location('bootstrap', BOOTSTRAP)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(tmp_path, **changes):
    environment = {**os.environ, **changes}
    return subprocess.run([sys.executable, str(BOOTSTRAP), '--venv', str(tmp_path / 'venv')],
                          env=environment, capture_output=True, text=True)


def test_a_missing_compiler_is_one_clear_line(tmp_path):
    done = run(tmp_path, CXX='no-such-compiler')
    assert done.returncode == 1
    assert done.stderr.strip() == (
        'setup: no C++ compiler ("no-such-compiler") found: install g++ '
        '(Debian, Ubuntu: apt install g++)')
    assert not (tmp_path / 'venv').exists()


def test_another_ros_distribution_is_refused(tmp_path):
    done = run(tmp_path, ROS_DISTRO='humble', AMENT_PREFIX_PATH='/opt/ros/humble')
    assert done.returncode == 1 and 'ROS humble is sourced; gdmp_ros needs Jazzy' in done.stderr


def test_the_environment_s_own_python_does_not_make_it_again(bootstrap, tmp_path):
    """It is the first in PATH after the commands of the first page."""
    venv = (tmp_path / 'venv').resolve()
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', str(venv)], check=True)
    (venv / 'gdmp-setup.stamp').write_text(
        f'{bootstrap.fingerprint(None)}\n{bootstrap.messages_fingerprint()}')
    environment = {name: value for name, value in os.environ.items()
                   if name not in ('ROS_DISTRO', 'AMENT_PREFIX_PATH')}
    for options in ([], ['-S']):
        done = subprocess.run([venv / 'bin' / 'python3', *options, BOOTSTRAP, '--venv', venv],
                              env=environment, capture_output=True, text=True)
        assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


def test_an_environment_s_python_builds_on_the_one_it_was_made_with(tmp_path):
    venv = tmp_path / 'venv'
    subprocess.run([sys.executable, '-m', 'venv', '--without-pip', str(venv)], check=True)
    code = f'import runpy; print(runpy.run_path({str(BOOTSTRAP)!r})["PYTHON"])'
    named = subprocess.run([venv / 'bin' / 'python3', '-S', '-c', code], check=True,
                           capture_output=True, text=True).stdout.strip()
    assert named == os.path.realpath(sys.executable) and str(venv) not in named


def test_an_unsupported_python_is_refused(bootstrap, monkeypatch):
    monkeypatch.setattr(bootstrap.sys, 'version_info', (3, 10, 0))
    with pytest.raises(bootstrap.SetupError, match='use one of 3.11, 3.12, 3.13'):
        bootstrap.check_machine()


def test_no_network_is_one_clear_line(bootstrap, tmp_path):
    log = tmp_path / 'log'
    with pytest.raises(bootstrap.SetupError, match='is there a network'):
        bootstrap.run('installing packages', [
            sys.executable, '-m', 'pip', 'install', '--isolated', '--retries', '0', '--index-url',
            'http://127.0.0.1:9/simple', 'no-such-package'], log)


def test_a_long_step_prints_progress(bootstrap, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bootstrap, 'EVERY_S', 0.2)
    code = 'import time; print("step one", flush=True); time.sleep(1.0)'
    bootstrap.run('waiting', [sys.executable, '-c', code], tmp_path / 'log')
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'setup: waiting …' and len(lines) >= 3
    assert lines[-1].startswith('setup: waiting, ') and lines[-1].endswith('step one')


def test_changed_messages_are_built_without_a_new_environment(bootstrap, tmp_path, monkeypatch):
    steps = []
    for name in ('install_packages', 'build_messages', 'install_project'):
        monkeypatch.setattr(bootstrap, name, lambda *_, name=name: steps.append(name))
    monkeypatch.setattr(bootstrap, 'sourced_ros', lambda: None)
    venv = tmp_path / 'venv'
    venv.mkdir()
    bootstrap.make(venv)
    assert steps == ['install_packages', 'build_messages', 'install_project']
    monkeypatch.setattr(bootstrap, 'messages_fingerprint', lambda: 'changed')
    steps.clear()
    bootstrap.make(venv)
    assert steps == ['build_messages']
    steps.clear()
    bootstrap.make(venv)
    assert steps == []


def test_a_sourced_ros_replaces_the_wheels_and_keeps_its_numpy(bootstrap, tmp_path, monkeypatch):
    lock = bootstrap.locked('/opt/ros/jazzy', sys.executable, tmp_path / 'lock').read_text()
    assert 'ros-rclpy' not in lock and 'mujoco==' in lock
    old = tmp_path / 'python'
    old.write_text('#!/bin/sh\necho 1.26.4\n')
    old.chmod(0o755)
    kept = bootstrap.locked('/opt/ros/jazzy', old, tmp_path / 'lock').read_text()
    assert 'numpy==1.26.4' in kept
    assert 'ros-rclpy==' in bootstrap.locked(None, old, tmp_path / 'lock').read_text()


def test_configuration_files_and_the_page_of_parameters_are_those_of_the_nodes():
    from gdmp_ros.ros import parameter_tables
    for path, text in parameter_tables.files().items():
        assert (ROOT / path).read_text() == text, 'python -m gdmp_ros.ros.parameter_tables'
    for node, (_, specs) in parameter_tables.NODES.items():
        document = yaml.safe_load((ROOT / 'config' / f'{node}.yaml').read_text())
        assert document[f'/**/{node}']['ros__parameters'] == {s.name: s.default for s in specs}


def test_the_package_names_what_it_imports_and_launches():
    """Packages of ROS that are imported, or of which a launch file starts something."""
    text = (ROOT / 'package.xml').read_text()
    known = set(re.findall(r'<(?:exec_)?depend>([^<]+)<', text))
    ours = {'gdmp_ros', 'launch'}
    wanted = set()
    for path in [*(ROOT / 'gdmp_ros').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]:
        for node in ast.walk(ast.parse(path.read_text())):
            names = ([alias.name for alias in node.names] if isinstance(node, ast.Import) else
                     [node.module or ''] if isinstance(node, ast.ImportFrom) else [])
            wanted |= {name.partition('.')[0] for name in names}
        wanted |= set(re.findall(r"package='(\w+)'", path.read_text()))
    folders = [Path(folder) for folder in sys.path if Path(folder).is_dir()]
    of_ros = {name for name in wanted - ours if re.search(
        r'(_msgs|_interfaces|^rcl|^rclpy|^tf2|^ament|^rosidl|^launch)', name) and (
        name == 'tf2_ros' or any((folder / name).is_dir() for folder in folders))}
    assert of_ros and of_ros <= known, of_ros - known
    for module, package in (('yaml', 'python3-yaml'), ('numpy', 'python3-numpy'),
                            ('scipy', 'python3-scipy'), ('psutil', 'python3-psutil')):
        assert module not in wanted or package in known


def test_versions_agree():
    import gdmp_ros
    for path, text in (('setup.py', f"version='{gdmp_ros.__version__}'"),
                       ('package.xml', f'<version>{gdmp_ros.__version__}</version>'),
                       ('msg_defs/package.xml', f'<version>{gdmp_ros.__version__}</version>'),
                       ('CHANGELOG.rst', gdmp_ros.__version__)):
        assert text in (ROOT / path).read_text()

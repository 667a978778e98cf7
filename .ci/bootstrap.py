"""
Set up a virtual environment that runs everything: ``make setup`` calls this.

Installs the pinned packages of ``requirements.lock``, and a server of the protocol of a Franka
beside them, builds ``gdmp_msgs`` from ``msg_defs/`` (and ``tf2_msgs``, where ROS has none) into
the environment, installs ``gdmp_ros`` editable and compiles its kernels. If a Jazzy installation
is sourced, its rclpy is used instead of the wheels. Without changes it does nothing, quickly;
after a change of the messages it builds only these.
"""
import argparse
import configparser
import hashlib
import os
from pathlib import Path
import shutil
import subprocess
import sys
import sysconfig
import time

ROOT = Path(__file__).resolve().parent.parent
SUPPORTED = ((3, 11), (3, 12), (3, 13))
#: The interpreter itself, not that of an environment: the environment may be replaced here.
PYTHON = os.path.realpath(sys._base_executable)  # noqa: SLF001  no public name
#: Lines of the lock file that a sourced ROS installation replaces.
ROS_PREFIXES = ('ros-',)
#: Newest Python for which there is a server of the protocol of a Franka.
PROTOCOL_SERVER_PYTHON = (3, 12)
#: Time between two lines of progress [s].
EVERY_S = 2.0


class SetupError(Exception):
    """One clear line for the user."""


def sourced_ros():
    """Prefixes of a sourced ROS installation, or None; only Jazzy is accepted."""
    distribution, prefixes = os.environ.get('ROS_DISTRO'), os.environ.get('AMENT_PREFIX_PATH')
    if not distribution or not prefixes:
        return None
    if distribution != 'jazzy':
        raise SetupError(f'ROS {distribution} is sourced; gdmp_ros needs Jazzy (or no ROS at all: '
                         'unset ROS_DISTRO and AMENT_PREFIX_PATH)')
    return prefixes


def check_machine():
    """Refuse a machine that lacks something, before anything is installed."""
    if sys.version_info[:2] not in SUPPORTED:
        names = ', '.join('.'.join(map(str, version)) for version in SUPPORTED)
        raise SetupError(f'Python {sys.version.split()[0]} is not supported: use one of {names} '
                         '(make setup PYTHON=python3.12)')
    compiler = os.environ.get('CXX', 'c++')
    if shutil.which(compiler) is None:
        raise SetupError(f'no C++ compiler ("{compiler}") found: install g++ '
                         '(Debian, Ubuntu: apt install g++)')
    if not Path(sysconfig.get_path('include'), 'Python.h').exists():
        raise SetupError('the Python headers are missing: install them '
                         '(Debian, Ubuntu: apt install python3-dev)')


def fingerprint(prefixes):
    """Hash of everything that the environment is made from, except for the messages."""
    digest = hashlib.sha256(f'{sys.version}{PYTHON}{prefixes}{ROOT}'.encode())
    add_files(digest, [*(ROOT / name for name in ('requirements.lock', 'setup.py', 'setup.cfg',
                                                '.ci/franka-sim.lock')), Path(__file__)])
    return digest.hexdigest()


def messages_fingerprint():
    """Hash of the message definitions."""
    digest = hashlib.sha256()
    add_files(digest, sorted(path for folder in (ROOT / 'msg_defs', ROOT / '.ci' / 'tf2_msgs')
                             for path in folder.rglob('*') if path.is_file()))
    return digest.hexdigest()


def add_files(digest, paths):
    """Add names and contents of files to a hash."""
    for path in paths:
        digest.update(path.name.encode() + path.read_bytes())


def run(what, command, log, **options):
    """Run a step with lines of progress; its output goes to the log."""
    print(f'setup: {what} …', flush=True)
    with log.open('a') as out:
        out.write(f'$ {" ".join(map(str, command))}\n')
        out.flush()
        step = subprocess.Popen(list(map(str, command)), stdout=out, stderr=subprocess.STDOUT,
                                **options)
        try:
            wait_for(step, what, log)
        except BaseException:
            step.kill()
            step.wait()
            raise
    if step.returncode != 0:
        text = log.read_text()
        offline = any(word in text for word in ('NewConnectionError', 'Temporary failure in name',
                                                'No matching distribution', 'ProxyError'))
        hint = 'the package index cannot be reached: is there a network? ' if offline else ''
        raise SetupError(f'{what} failed: {hint}see {log}')


def wait_for(step, what, log):
    """Wait for a process; print the newest line of its log every two seconds."""
    begun = time.monotonic()
    while True:
        try:
            step.wait(EVERY_S)
            return
        except subprocess.TimeoutExpired:
            lines = log.read_text(errors='replace').split('\n')
            newest = next((line for line in reversed(lines) if line.strip()), '').strip()
            print(f'setup: {what}, {time.monotonic() - begun:.0f} s: {newest[:60]}', flush=True)


def locked(prefixes, python, target):
    """
    Write the lock to use; if ROS is sourced, without ROS wheels and with the NumPy of ROS.

    ``python`` is the interpreter of ROS: it imports the NumPy that ROS was built with.
    """
    lines = (ROOT / 'requirements.lock').read_text().splitlines()
    if prefixes:
        lines = [line for line in lines if not line.startswith(ROS_PREFIXES)]
        found = subprocess.run([python, '-c', 'import numpy; print(numpy.__version__)'],
                               capture_output=True, text=True)
        if found.returncode == 0 and found.stdout.startswith('1.'):
            # Message extensions of an apt Jazzy are compiled against NumPy 1 and refuse NumPy 2.
            lines = [f'numpy=={found.stdout.strip()}' if line.startswith('numpy==') else line
                     for line in lines]
    target.write_text('\n'.join(lines) + '\n')
    return target


def correct_exports(venv, python):
    """
    Correct the include folders in the CMake files of the wheels.

    They name the folders of the machine on which the wheels were built.
    """
    numpy_include = subprocess.run([python, '-c', 'import numpy; print(numpy.get_include())'],
                                   capture_output=True, text=True, check=True).stdout.strip()
    python_include = sysconfig.get_path('include')
    for path in venv.glob('share/*/cmake/export_*__rosidl_generator_pyExport.cmake'):
        words = []
        for line in path.read_text().split('\n'):
            if 'INTERFACE_INCLUDE_DIRECTORIES' in line:
                head, _, tail = line.partition('"')
                folders, _, rest = tail.partition('"')
                folders = ';'.join(python_include if '/include/python3' in folder
                                   else numpy_include if folder.endswith(
                                       ('numpy/_core/include', 'numpy/core/include')) else folder
                                   for folder in folders.split(';'))
                line = f'{head}"{folders}"{rest}'
            words.append(line)
        path.write_text('\n'.join(words))


def build_messages(venv, python, prefixes, log):
    """Build ``gdmp_msgs``, and ``tf2_msgs`` if ROS has none, and install them."""
    search = [str(venv), *(prefixes.split(os.pathsep) if prefixes else [])]
    packages = {'gdmp_msgs': ROOT / 'msg_defs'}
    # The environment may have ours already.
    if not any(Path(prefix, 'share', 'tf2_msgs').is_dir() for prefix in search[1:]):
        packages['tf2_msgs'] = ROOT / '.ci' / 'tf2_msgs'
    for name, source in packages.items():
        build_package(name, source, venv, python, search, log)


def build_package(name, source, venv, python, search, log):
    """Build a package of messages and install it into the environment."""
    build = venv / 'build' / name
    shutil.rmtree(build, ignore_errors=True)
    environment = dict(os.environ, AMENT_PREFIX_PATH=os.pathsep.join(search),
                       CMAKE_PREFIX_PATH=os.pathsep.join(search),
                       PATH=os.pathsep.join([str(venv / 'bin'), os.environ['PATH']]))
    cmake = venv / 'bin' / 'cmake'
    run(f'configuring {name}',
        [cmake, '-G', 'Ninja', '-S', source, '-B', build,
         f'-DCMAKE_INSTALL_PREFIX={venv}', f'-DPython3_EXECUTABLE={python}',
         '-DCMAKE_BUILD_TYPE=Release', '-DBUILD_TESTING=OFF', '-Wno-dev'], log, env=environment)
    run(f'building {name}', [cmake, '--build', build, '--target', 'install'], log,
        env=environment)


def write_wrappers(venv, prefixes):
    """
    Write executables that set the environment of the sourced ROS installation.

    The wheels have a start-up hook that does the same.
    """
    libraries = [str(venv / 'lib'), *os.environ.get('LD_LIBRARY_PATH', '').split(os.pathsep)]
    values = {'ROS_DISTRO': 'jazzy',
              'AMENT_PREFIX_PATH': os.pathsep.join([str(venv), prefixes]),
              'LD_LIBRARY_PATH': os.pathsep.join(filter(None, libraries)),
              'PYTHONPATH': os.environ.get('PYTHONPATH', '')}
    exports = ''.join(f"export {name}='{value}'\n" for name, value in values.items())
    scripts = configparser.ConfigParser()
    scripts.read(next(venv.glob('lib/python*/site-packages/gdmp_ros-*.dist-info/entry_points.txt')))
    for name, target in scripts['console_scripts'].items():
        script = venv / 'bin' / name
        script.write_text(f'#!/bin/sh\n{exports}'
                          f"exec '{venv}/bin/python' -m {target.partition(':')[0]} \"$@\"\n")
        script.chmod(0o755)
    python = venv / 'bin' / 'python-ros'
    python.write_text(f'#!/bin/sh\n{exports}exec \'{venv}/bin/python\' "$@"\n')
    python.chmod(0o755)


def make(venv):
    """Bring the environment up to date."""
    prefixes = sourced_ros()
    check_machine()
    stamp = venv / 'gdmp-setup.stamp'
    found = stamp.read_text().split() if stamp.exists() else []
    wanted = [fingerprint(prefixes), messages_fingerprint()]
    if found == wanted:
        return
    log, python = venv / 'setup.log', venv / 'bin' / 'python'
    only_messages = found[:1] == wanted[:1]
    stamp.unlink(missing_ok=True)
    if not only_messages:
        install_packages(venv, python, prefixes, log)
    build_messages(venv, python, prefixes, log)
    if not only_messages:
        install_project(venv, python, prefixes, log)
    stamp.write_text('\n'.join(wanted))
    print(f'setup: done, {venv}')


def install_packages(venv, python, prefixes, log):
    """Replace the environment by a new one with the packages of the lock file."""
    shutil.rmtree(venv, ignore_errors=True)
    venv.mkdir(parents=True)
    run('creating the environment', [PYTHON, '-m', 'venv', venv], log)
    lock = locked(prefixes, PYTHON, venv / 'requirements.txt')
    run('installing packages (about a minute)',
        [python, '-I', '-m', 'pip', 'install', '--disable-pip-version-check', '-r', lock], log)
    if not prefixes:
        correct_exports(venv, python)


def install_project(venv, python, prefixes, log):
    """Install ``gdmp_ros`` and compile its kernels."""
    run('installing gdmp_ros',
        [python, '-I', '-m', 'pip', 'install', '--disable-pip-version-check', '--no-deps',
         '--no-build-isolation', '--use-pep517', '-e', ROOT], log)
    if prefixes:
        write_wrappers(venv, prefixes)
    install_protocol_server(venv, log)
    run('compiling the kernels (half a minute)',
        [venv / 'bin' / 'gdmp', 'doctor', '--compile'], log)


def install_protocol_server(venv, log):
    """
    Install the server of the protocol of a Franka, for tests and the demonstration.

    It needs older packages than we do, so it gets an environment of its own.
    """
    if sys.version_info[:2] > PROTOCOL_SERVER_PYTHON:
        return
    folder = venv.parent / '.venv-franka-sim'
    shutil.rmtree(folder, ignore_errors=True)
    run('creating the environment of the protocol server', [PYTHON, '-m', 'venv', folder], log)
    run('installing the protocol server',
        [folder / 'bin' / 'python', '-I', '-m', 'pip', 'install', '--disable-pip-version-check',
         '-r', ROOT / '.ci' / 'franka-sim.lock'], log)


def main():
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--venv', type=Path, default=ROOT / '.venv', help='where to put it')
    venv = parser.parse_args().venv.resolve()
    try:
        make(venv)
    except SetupError as error:
        sys.exit(f'setup: {error}')
    except OSError as error:
        sys.exit(f'setup: {error.filename or ""}: {error.strerror}')
    except KeyboardInterrupt:
        sys.exit('setup: interrupted; run it again')


if __name__ == '__main__':
    main()

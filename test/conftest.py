"""What every test may ask for, and what none may leave behind."""
import contextlib
import ctypes
import signal

import numpy as np
import psutil
import pytest

from gdmp_ros.data import lasa
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.util.processes import thread_names

_PR_SET_CHILD_SUBREAPER = 36
#: Helpers of libraries that stay until this process ends.
_HELPERS = ('resource_tracker', 'joblib.externals.loky')

#: What runs nodes as processes in real time: one test after the other, or they would compete.
_REAL_TIME = ('test/processes/', 'test/franka/', 'test/experiments/reliability/')


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Let one worker run all tests in real time; the other files go to any worker."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid):
            return 'real time' if nodeid.startswith(_REAL_TIME) else super()._split_scope(nodeid)
    return Scheduling(config, log)


@pytest.fixture
def rng():
    return np.random.default_rng(7)


@pytest.fixture(scope='session')
def letters():
    """Seven demonstrations of a letter, of pose and stiffness; not to be changed."""
    return lasa.robot_demonstrations('GShape')


@pytest.fixture(scope='session')
def letter(letters):
    """A skill that was learned from the first of `letters`."""
    return Skill.learn(letters[0])


@pytest.fixture(scope='session')
def skill(letters):
    """A short skill of pose and stiffness, close to the first pose of the simulated arm."""
    shown = letters[0]
    return Skill.learn(Demonstration(shown.times * (2.0 / shown.duration), shown.points,
                                     shown.manifold))


@pytest.fixture(scope='module')
def skill_file(skill, tmp_path_factory):
    """The skill as a file. A test file that defines `skill` itself gets its own one."""
    path = tmp_path_factory.mktemp('skill') / 'skill.json'
    skill.save(path)
    return path


@pytest.fixture(scope='session', autouse=True)
def _adopt_orphans():
    """Processes whose parent has gone become this one's, so that they can be found."""
    ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)


@pytest.fixture(scope='session', autouse=True)
def _with_ctrl_c():
    """Children would ignore it, as this process does if it is a job in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _left_running():
    """Descendants that still run; those that have ended are read off."""
    found = [one for one in psutil.Process().children(recursive=True)
             if not any(helper in _words(one) for helper in _HELPERS)]
    _, alive = psutil.wait_procs(found, timeout=5.0)
    return alive


def _words(process):
    try:
        return ' '.join(process.cmdline())
    except psutil.NoSuchProcess:
        return 'ended'


def _participants():
    """Threads that look for other participants of DDS: at ports 7400 + 250 times the domain."""
    return [name for name in thread_names().values() if name.startswith('dds.udp.')
            and (int(name.removeprefix('dds.udp.')) - 7400) % 250 == 0]


@pytest.fixture(scope='module', autouse=True)
def nothing_left_running():
    """
    No test file leaves a process behind, not even one whose parent has gone, nor a participant.

    Participants of one domain that are left find each other again and again: nothing else runs.
    """
    yield
    left, participants = _left_running(), _participants()
    told = [f'{one.pid}: {_words(one)[:200]}' for one in left]
    for one in left:
        with contextlib.suppress(psutil.NoSuchProcess):
            one.kill()
    assert not told, told
    assert not participants, participants


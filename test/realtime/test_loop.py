"""The periodic loop on a scripted clock, its statistics, DDS domains and child processes."""
import gc
import os
import subprocess
import sys
import threading
import time

import numpy as np
import psutil
import pytest

from gdmp_ros.errors import GdmpError
from gdmp_ros.realtime.loop import periodic, raised_priority, run, SystemClock
from gdmp_ros.realtime.statistics import LatenessRecorder, punctuality_of
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.processes import ChildProcesses


class ScriptedClock:
    """Time passes only in sleeps, which end late by the scripted times."""

    def __init__(self, overshoot):
        self.time = 0
        self.overshoot = iter(overshoot)

    def now(self):
        return self.time

    def sleep_until(self, deadline_ns):
        self.time = max(self.time, deadline_ns) + next(self.overshoot, 0)


def test_sleep_overshoot_never_accumulates():
    seen, clock = [], ScriptedClock([300] * 100)
    run(periodic(lambda deadline, now: seen.append((deadline, now)), 1000, clock), clock,
        lambda: len(seen) >= 50)
    assert [deadline for deadline, _ in seen] == [1000 * (i + 1) for i in range(50)]
    assert all(now - deadline == 300 for deadline, now in seen)


def test_an_overrun_drops_ticks_instead_of_bursting():
    seen, clock = [], ScriptedClock([0, 0, 3500] + [0] * 20)
    run(periodic(lambda deadline, now: seen.append(deadline), 1000, clock), clock,
        lambda: len(seen) >= 6)
    assert seen == [1000, 2000, 3000, 7000, 8000, 9000]


def test_lateness_is_counted_and_summed_up():
    recorder = LatenessRecorder(1000, capacity=64)
    for deadline in [*range(1000, 51_000, 1000), *range(53_000, 103_000, 1000)]:
        recorder.add(deadline, deadline + 100)
    figures = recorder.punctuality()
    assert (figures.ticks, figures.missed) == (100, 2)
    assert figures.p50_us == 0.1 and figures.max_us == 0.1
    assert len(recorder.ticks_kept()) == 64
    window = punctuality_of(np.array([[0, 0], [1000, 10], [4000, 20]]), 1000)
    assert window.missed == 2 and window.ticks == 3
    assert abs(window.rate_hz - 2 / 4e-6) < 1e-6
    # Deadlines that a loop moves by a hundredth of a period.
    window = punctuality_of(np.array([[0, 0], [990, 10], [2970, 20]]), 1000)
    assert window.missed == 1


def ended(clock, loop, priority=None):
    """A loop after its end."""
    thread = clock.start(loop, priority)
    thread.join()
    return thread


def test_a_loop_on_the_real_clock_keeps_its_grid():
    clock, recorder = SystemClock(), LatenessRecorder(2_000_000)
    begun = clock.now()

    def steps():
        loop = periodic(recorder.add, 2_000_000, clock)
        while recorder.ticks + recorder.missed < 100:
            yield next(loop)
    thread = ended(clock, steps(), -1)
    assert thread.scheduler in ('fifo', 'other')
    assert thread.failure is None
    assert gc.isenabled()
    deadlines, lateness = recorder.ticks_kept().T
    # Never early; late ticks are dropped, not made up for.
    assert (lateness >= 0).all() and deadlines[0] >= begun + 2_000_000
    assert (np.diff(deadlines) % 2_000_000 == 0).all() and (np.diff(deadlines) > 0).all()
    assert deadlines[-1] - deadlines[0] == (recorder.ticks + recorder.missed - 1) * 2_000_000


def test_only_the_streaming_thread_gets_priority():
    policies = {}

    def look():
        policies.update(inner=os.sched_getscheduler(0), collects=gc.isenabled())
        yield 0
    thread = ended(SystemClock(), look(), -1)
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
    expected = os.SCHED_FIFO if thread.scheduler == 'fifo' else os.SCHED_OTHER
    assert policies == {'inner': expected, 'collects': False}
    plain = ended(SystemClock(), look(), 0)
    assert plain.scheduler == 'other' and not policies['collects']
    slow = ended(SystemClock(), look())  # nothing that has deadlines
    assert slow.scheduler == 'other' and policies['collects']


def test_a_loop_that_ends_does_not_disturb_another_one():
    clock, interval = SystemClock(), sys.getswitchinterval()
    loops = [clock.start(periodic(lambda *_: None, 2_000_000, clock), 0) for _ in range(2)]
    shortest = sys.getswitchinterval()
    loops[0].end()
    loops[0].join()  # ended already
    during = gc.isenabled(), sys.getswitchinterval()
    loops[1].end()
    assert during == (False, shortest) and shortest < interval
    assert gc.isenabled() and sys.getswitchinterval() == interval


CHILD = 'import os; print(os.sched_getscheduler(0) == os.SCHED_OTHER)'


def test_priority_is_raised_only_beside_a_loop_with_priority():
    clock = SystemClock()
    with raised_priority():
        assert os.sched_getscheduler(0) == os.SCHED_OTHER
    thread = clock.start(periodic(lambda deadline, now: None, 2_000_000, clock), -1)
    try:
        with raised_priority():
            policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
            child = subprocess.run([sys.executable, '-c', CHILD], capture_output=True, text=True,
                                   check=True)
        after = os.sched_getscheduler(0)
    finally:
        thread.end()
    assert policy == (os.SCHED_FIFO if thread.scheduler == 'fifo' else os.SCHED_OTHER)
    assert after == os.SCHED_OTHER and child.stdout == 'True\n'


def test_a_failure_in_the_loop_is_kept():
    def fail():
        yield 0
        raise ValueError('broken')
    assert isinstance(ended(SystemClock(), fail(), 0).failure, ValueError)


def test_a_loop_that_is_ended_cleans_up_where_it_yields():
    clock, steps = SystemClock(), []

    def loop():
        try:
            while True:
                yield clock.now() + 1_000_000
                steps.append(threading.current_thread())
        finally:
            steps.append('end')
    thread = clock.start(loop())
    while len(steps) < 3:
        clock.sleep_until(clock.now() + 1_000_000)
    thread.end()
    assert steps[-1] == 'end' and threading.current_thread() not in steps


def test_domains_are_claimed_once():
    domains = [Domain() for _ in range(5)]
    assert len({d.id for d in domains}) == 5
    assert all(1 <= d.id <= 101 for d in domains)
    taken = domains[0].id
    for domain in domains:
        domain.release()
    again = Domain()
    assert again.id <= taken
    again.release()


def running(process):
    """Whether a process has not ended; a zombie has."""
    try:
        return process.status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


@pytest.mark.parametrize('after', [0.0, 0.5])
def test_children_do_not_outlive_their_parent(tmp_path, after):
    parent = subprocess.Popen([sys.executable, '-c', f"""
import pathlib, time
from gdmp_ros.util.processes import ChildProcesses
from test.lockstep.clock import SteppedClock
import os
children = ChildProcesses(os.environ, pathlib.Path({str(tmp_path)!r}))
children.start('child', 'gdmp_ros.realtime.bare_loop', [{str(tmp_path / "ticks.npy")!r}])
print(children.processes['child'].pid, flush=True)
time.sleep(60)
"""], stdout=subprocess.PIPE, text=True)
    child = psutil.Process(int(parent.stdout.readline()))
    time.sleep(after)
    parent.kill()
    parent.wait()
    ends = time.monotonic() + 20.0
    while running(child):
        assert time.monotonic() < ends
        time.sleep(0.05)


def test_children_say_why_they_ended(tmp_path):
    with ChildProcesses(os.environ, tmp_path) as children:
        children.start('broken', 'gdmp_ros.no_such_module')
        children.processes['broken'].wait()
        with pytest.raises(GdmpError, match='(?s)broken ended with code 1.*no_such_module'):
            children.check()

"""Checks whether a machine is ready for a 1 kHz stream, and says what to change."""
from __future__ import annotations

from collections.abc import Callable
import ctypes
import importlib.util
import os
from pathlib import Path
import platform
import resource
import shutil
import sys
import threading
from typing import NamedTuple

from gdmp_ros.kernels import is_warm
from gdmp_ros.realtime.loop import NS, periodic, run, SystemClock
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.util.dds_network import (
    default_environment,
    RANGE,
    REACH,
    TRANSPORT,
    unasked_restriction,
)

GOOD, FAIR, BAD = 'good', 'could be better', 'bad'
PERIOD_NS = 1_000_000
#: 99th percentile of the lateness of a sleeping loop of normal priority [µs].
LATE_US, VERY_LATE_US = 500.0, 5000.0
#: Smallest receive buffer for DDS [bytes].
BUFFER = 200_000
_CLOCK_UNSYNCHRONISED = 5  # adjtimex: TIME_ERROR


class Finding(NamedTuple):
    """
    Result of one check.

    :ivar level: `GOOD`, `FAIR` or `BAD`
    :ivar advice: what to change; empty if nothing has to be changed
    """

    subject: str
    level: str
    found: str
    advice: str = ''


def examine(seconds: float = 2.0) -> list[Finding]:
    """
    Run all checks.

    :param seconds: duration of the measurement with a sleeping loop
    """
    return [check() for check in CHECKS] + [_lateness(seconds)]


def _read(path: str) -> str:
    try:
        return Path(path).read_text().strip()
    except OSError:
        return ''


def _python() -> Finding:
    result = f'{platform.python_version()} ({sys.executable})'
    if (3, 11) <= sys.version_info < (3, 14):
        return Finding('Python', GOOD, result)
    return Finding('Python', BAD, result, 'use Python 3.11, 3.12 or 3.13')


def _kernel() -> Finding:
    release = platform.release()
    if _read('/sys/kernel/realtime') == '1':
        return Finding('kernel', GOOD, f'{release}, PREEMPT_RT')
    return Finding('kernel', FAIR, f'{release}, without PREEMPT_RT',
                   'install a kernel with PREEMPT_RT (Ubuntu: sudo pro enable realtime-kernel): '
                   'it bounds the lateness, which an arm with 1 kHz commands needs')


def _cores() -> Finding:
    count = len(os.sched_getaffinity(0))
    if count >= 4:
        return Finding('cores', GOOD, str(count))
    return Finding('cores', FAIR, str(count), 'server, simulation and recorder together need '
                   'one core; with fewer than four cores run nothing else while streaming')


def _governor() -> Finding:
    governor = _read('/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor')
    if governor in ('', 'performance'):
        return Finding('CPU frequency', GOOD, governor or 'not scaled by this system')
    return Finding('CPU frequency', FAIR, f'governor {governor}',
                   'sudo cpupower frequency-set -g performance')


def _fifo() -> Finding:
    granted: list[bool] = []

    def request() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(40))
            granted.append(True)
        except OSError:
            granted.append(False)
    thread = threading.Thread(target=request)
    thread.start()
    thread.join()
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    if granted[0]:
        return Finding('SCHED_FIFO', GOOD, 'granted, priority 40')
    return Finding('SCHED_FIFO', BAD, f'not granted (limit of rtprio: {limit})',
                   'put "@realtime - rtprio 98" into /etc/security/limits.d/realtime.conf, add '
                   'yourself to the group realtime, and log in again')


def _clock_source() -> Finding:
    source = _read('/sys/devices/system/clocksource/clocksource0/current_clocksource')
    if source in ('', 'tsc', 'kvm-clock', 'arch_sys_counter', 'hyperv_clocksource_tsc_page'):
        return Finding('clock source', GOOD, source or 'unknown')
    return Finding('clock source', FAIR, source, 'reading this clock is slow; tsc is missing '
                   'or unstable (dmesg | grep -i tsc)')


def _synchronised() -> Finding:
    status = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(512))
    if status not in (-1, _CLOCK_UNSYNCHRONISED):
        return Finding('wall clock', GOOD, 'synchronised')
    return Finding('wall clock', FAIR, 'not synchronised',
                   'with two machines install chrony on both: references are refused if their '
                   'stamps differ by more than stamp_tolerance (0.5 s). With one machine this '
                   'does not matter')


def _middleware() -> Finding:
    if importlib.util.find_spec('rclpy') is None:
        return Finding('ROS 2', FAIR, 'rclpy is not installed',
                       'the nodes need it: make setup, or source /opt/ros/jazzy/setup.bash; the '
                       'library works without it')
    if importlib.util.find_spec('gdmp_msgs') is None:
        return Finding('ROS 2', BAD, 'rclpy, but not gdmp_msgs',
                       'build msg_defs: make setup, or colcon build --base-paths . msg_defs')
    domain = os.environ.get('ROS_DOMAIN_ID', '0')
    return Finding('ROS 2', GOOD, f'rclpy and gdmp_msgs, domain {domain}, '
                   f'{os.environ.get("RMW_IMPLEMENTATION", "default middleware")}')


def _reach() -> Finding:
    chosen = [name for name in (*REACH, *TRANSPORT) if os.environ.get(name)]
    given = default_environment()
    if RANGE in given:
        return Finding('DDS', GOOD, unasked_restriction() or 'this machine only, over UDP')
    words = ', '.join(f'{name}={os.environ[name]}' for name in chosen)
    if 'FASTDDS_BUILTIN_TRANSPORTS' in (*chosen, *given):
        return Finding('DDS', GOOD, f'{words}, over {given.get("FASTDDS_BUILTIN_TRANSPORTS", "")}'
                       if given else words)
    return Finding('DDS', FAIR, words, 'set FASTDDS_BUILTIN_TRANSPORTS=UDPv4: with shared '
                   'memory a killed node can block the communication of others')


def _buffers() -> Finding:
    size = int(_read('/proc/sys/net/core/rmem_max') or 0)
    if size >= BUFFER:
        return Finding('UDP buffers', GOOD, f'{size} bytes')
    return Finding('UDP buffers', FAIR, f'{size} bytes',
                   'sudo sysctl -w net.core.rmem_max=2097152')


def _shared_memory() -> Finding:
    folder = Path('/dev/shm')
    left = ([path for path in folder.iterdir() if 'fastrtps_' in path.name]
            if folder.is_dir() else [])
    if not left:
        return Finding('shared memory', GOOD, 'no files left by DDS')
    return Finding('shared memory', FAIR, f'{len(left)} files of Fast DDS in /dev/shm',
                   'if no other ROS program runs, killed programs left them, and they can block '
                   'the communication of new ones: rm /dev/shm/fastrtps_* /dev/shm/sem.fastrtps_*')


def _disk() -> Finding:
    free = shutil.disk_usage(Path.cwd()).free / 1e9
    level = GOOD if free > 2.0 else FAIR if free > 0.2 else BAD
    return Finding('disk', level, f'{free:.1f} GB free here',
                   '' if level == GOOD else 'a recorded run needs 1 MB per second; recording '
                   'stops when 64 MB are left')


def _kernels() -> Finding:
    if is_warm():
        return Finding('compiled kernels', GOOD, 'in the cache')
    return Finding('compiled kernels', FAIR, 'not in the cache', 'run gdmp doctor --compile, or '
                   'the first start compiles them; GDMP_CACHE names the folder of the cache')


def _lateness(seconds: float) -> Finding:
    recorder, clock = LatenessRecorder(PERIOD_NS), SystemClock()
    ends = clock.now() + round(seconds * NS)
    run(periodic(recorder.add, PERIOD_NS, clock), clock, lambda: clock.now() > ends)
    figures = recorder.punctuality(round(1000 * seconds))
    result = (f'{figures.rate_hz:.1f} Hz, lateness p50 {figures.p50_us:.0f}, p99 '
              f'{figures.p99_us:.0f}, largest {figures.max_us:.0f} µs, {figures.missed} missed')
    if figures.p99_us < LATE_US:
        return Finding('sleeping 1 kHz loop', GOOD, result)
    level = FAIR if figures.p99_us < VERY_LATE_US else BAD
    return Finding('sleeping 1 kHz loop', level, result,
                   'other programs use the cores: close them, or give the stream SCHED_FIFO')


CHECKS: tuple[Callable[[], Finding], ...] = (
    _python, _kernel, _cores, _governor, _fifo, _clock_source, _synchronised, _middleware, _reach,
    _buffers, _shared_memory, _disk, _kernels)

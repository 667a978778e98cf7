"""How punctually the nodes stream: server and simulation beside a bare loop that only sleeps."""
from __future__ import annotations

import os
from pathlib import Path
import tempfile
import time
from typing import Any

import numpy as np
import psutil

from gdmp_ros.data import lasa, recordings
from gdmp_ros.data.bags import NS
from gdmp_ros.experiments import timing
from gdmp_ros.realtime.statistics import punctuality_of
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.optional_imports import optional_import, ROS
from gdmp_ros.util.processes import ChildProcesses

TITLE = '1 kHz over DDS: lateness beside a bare sleeping loop, CPU'
PERIOD_NS = 1_000_000
NODES = ('trajectory_server', 'panda_sim')


def run(settings: timing.Settings) -> dict[str, Any]:
    """Stream a skill again and again for ``settings.seconds`` and look at every tick."""
    domain = Domain()
    try:
        with tempfile.TemporaryDirectory(prefix='gdmp-stream-') as folder:
            return _stream(Path(folder), settings.seconds, domain.environment())
    finally:
        domain.release()


def _stream(folder: Path, seconds: float, environment: dict[str, str]) -> dict[str, Any]:
    os.environ.update(environment)  # before rclpy is loaded: this process joins the same domain
    with optional_import(ROS):
        from gdmp_ros.ros.clients.server_client import Operator
    bag = folder / 'demonstration'
    recordings.write(bag, lasa.robot_demonstrations('GShape')[0], 'panda_link0', 10 ** 9 * NS)
    files = {name: folder / f'{name}.npy' for name in (*NODES, 'bare')}
    with ChildProcesses(environment, folder / 'logs') as children:
        children.start_node('panda_sim', 'gdmp_ros.ros.arm.node', {
            'lateness_file': str(files['panda_sim'])})
        children.start_node('trajectory_server', 'gdmp_ros.ros.server.node', {
            'demonstrations': [str(bag)], 'measured_pose_topic': '/panda_sim/measured_pose',
            'lateness_file': str(files['trajectory_server'])})
        children.start('bare', 'gdmp_ros.realtime.bare_loop', [str(files['bare'])])
        operator = Operator(check=children.check)
        try:
            operator.wait_status('holding', 300.0)
            begun, used = time.monotonic_ns(), _used(children)
            motions = 0
            while time.monotonic_ns() - begun < seconds * NS:
                operator.execute()
                operator.result(60.0)
                motions += 1
            ended, spent = time.monotonic_ns(), _used(children)
            scheduler = operator.state.scheduler if operator.state else ''
        finally:
            operator.close()
    elapsed = (ended - begun) / NS
    document: dict[str, Any] = {'seconds': elapsed, 'motions': motions, 'scheduler': scheduler}
    for name, file in files.items():
        ticks = np.load(file)
        inside = (ticks[:, 0] >= begun) & (ticks[:, 0] <= ended)
        document[name] = punctuality_of(ticks[inside], PERIOD_NS)._asdict()
        if name in used:
            document[name]['cpu'] = (spent[name] - used[name]) / elapsed
    return document


def _used(children: ChildProcesses) -> dict[str, float]:
    return {name: sum(psutil.Process(children.processes[name].pid).cpu_times()[:2])
            for name in NODES}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heads, then lines."""
    lines = []
    for name in (*NODES, 'bare'):
        d = document[name]
        lines.append([name.replace('bare', 'bare sleeping loop'), f'{d["rate_hz"]:.1f}',
                      f'{d["missed"]} of {d["ticks"]}', f'{d["p50_us"]:.0f}',
                      f'{d["p99_us"]:.0f}', f'{d["max_us"]:.0f}',
                      f'{d["cpu"]:.2f}' if 'cpu' in d else ''])
    return [['process', 'Hz', 'missed', 'lateness p50 µs', 'p99', 'max', 'cores'], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Lateness of the three."""
    names = (*NODES, 'bare')
    for i, (key, hatch) in enumerate((('p50_us', ''), ('p99_us', '/'), ('max_us', 'x'))):
        axes.bar(np.arange(3) + 0.27 * (i - 1), [document[n][key] for n in names], 0.25,
                 color='0.8', edgecolor='black', hatch=hatch, label=key[:3])
    axes.set_xticks(range(3), ['trajectory_server', 'panda_sim', 'bare loop'])
    axes.set(ylabel='lateness [µs]', yscale='log', title=TITLE)
    axes.legend()

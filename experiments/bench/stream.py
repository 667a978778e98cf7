"""Lateness and CPU load of the nodes, compared with a bare loop that only sleeps."""
from __future__ import annotations

from pathlib import Path
import tempfile
import time
from typing import Any, TYPE_CHECKING

import numpy as np
import psutil

from experiments import timing
from gdmp_ros.data import lasa, recordings
from gdmp_ros.data.bags import NS
from gdmp_ros.realtime.statistics import punctuality_of
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.optional_imports import optional_import, ROS

if TYPE_CHECKING:
    from gdmp_ros.ros.clients.testbed import NodeTestbed

TITLE = '1 kHz over DDS: lateness compared with a bare sleeping loop, CPU'
PERIOD_NS = 1_000_000
NODES = ('trajectory_server', 'panda_sim')


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Stream a skill repeatedly for ``settings.seconds``, and evaluate every tick."""
    with optional_import(ROS):
        from gdmp_ros.ros.clients.testbed import NodeTestbed
    with tempfile.TemporaryDirectory(prefix='gdmp-stream-') as name, Domain() as domain:
        folder = Path(name)
        with NodeTestbed(folder, domain.environment()) as bed:
            window, document = _stream(bed, folder, settings.seconds)
        return _with_lateness(document, folder, window)


def _file(folder: Path, name: str) -> str:
    return str(folder / f'{name}.npy')


def _stream(bed: NodeTestbed, folder: Path, seconds: float
            ) -> tuple[tuple[int, int], dict[str, Any]]:
    bag = folder / 'demonstration'
    recordings.write(bag, lasa.robot_demonstrations('GShape')[0], 'panda_link0',
                     recordings.EPOCH_NS)
    bed.children.start('bare', 'gdmp_ros.realtime.bare_loop', [_file(folder, 'bare')])
    bed.start(arm={'lateness_file': _file(folder, 'panda_sim')},
              server={'demonstrations': [str(bag)],
                      'lateness_file': _file(folder, 'trajectory_server')}, record=False)
    begun, used, motions = time.monotonic_ns(), _cpu_seconds(bed), 0
    while time.monotonic_ns() - begun < seconds * NS:
        bed.client.execute()
        bed.client.result(60.0)
        bed.client.check_failure()
        motions += 1
    ended, used_then = time.monotonic_ns(), _cpu_seconds(bed)
    elapsed = (ended - begun) / NS
    cpu = {name: (used_then[name] - used[name]) / elapsed for name in NODES}
    return (begun, ended), {'seconds': elapsed, 'motions': motions,
                            'scheduler': bed.state.scheduler,
                            **{name: {'cpu': cpu[name]} for name in NODES}}


def _with_lateness(document: dict[str, Any], folder: Path, window: tuple[int, int]
                   ) -> dict[str, Any]:
    for name in (*NODES, 'bare'):
        ticks = np.load(_file(folder, name))
        inside = (ticks[:, 0] >= window[0]) & (ticks[:, 0] <= window[1])
        document[name] = {**punctuality_of(ticks[inside], PERIOD_NS)._asdict(),
                          **document.get(name, {})}
    return document


def _cpu_seconds(bed: NodeTestbed) -> dict[str, float]:
    return {name: sum(psutil.Process(bed.children.processes[name].pid).cpu_times()[:2])
            for name in NODES}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = []
    for name in (*NODES, 'bare'):
        d = document[name]
        lines.append([name.replace('bare', 'bare sleeping loop'), f'{d["rate_hz"]:.1f}',
                      f'{d["missed"]} of {d["ticks"]}', f'{d["p50_us"]:.0f}',
                      f'{d["p99_us"]:.0f}', f'{d["max_us"]:.0f}',
                      f'{d["cpu"]:.2f}' if 'cpu' in d else ''])
    return [['process', 'Hz', 'missed', 'lateness p50 µs', 'p99', 'max', 'cores'], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Lateness of the three processes."""
    names = (*NODES, 'bare')
    for i, (key, hatch) in enumerate((('p50_us', ''), ('p99_us', '/'), ('max_us', 'x'))):
        axes.bar(np.arange(3) + 0.27 * (i - 1), [document[n][key] for n in names], 0.25,
                 color='0.8', edgecolor='black', hatch=hatch, label=key[:3])
    axes.set_xticks(range(3), ['trajectory_server', 'panda_sim', 'bare loop'])
    axes.set(ylabel='lateness [µs]', yscale='log', title=TITLE)
    axes.legend()

"""A live view of server and arm in the terminal."""
from __future__ import annotations

import sys
import time

from gdmp_msgs.msg import RobotState, ServerState
import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.ros.clients.client import Client
from gdmp_ros.ros.lifecycle import PolledGroup, reliable, take_latest

#: How often the view changes [s]; where nobody looks a line is printed so often instead.
REFRESH_S, LINE_S = 0.2, 1.0
#: A node that has said nothing for so long is silent [s].
SILENT_S = 1.0


class Watcher(Client):
    """Listens to a trajectory server, and looks at the newest state of the arm."""

    def __init__(self, server: str, arm: str):
        super().__init__('watch')
        self.server, self.arm = server, arm
        self.state: ServerState | None = None
        self.robot: RobotState | None = None
        self._heard = {'server': 0.0, 'arm': 0.0}
        self.node.create_subscription(ServerState, f'{server}/state', self._on_state,
                                      reliable(10))
        # At 1 kHz: only the newest is looked at.
        self._robot = self.node.create_subscription(RobotState, f'{arm}/state', lambda _: None,
                                                    reliable(1), callback_group=PolledGroup())

    def _on_state(self, message: ServerState) -> None:
        self.state, self._heard['server'] = message, time.monotonic()

    def look(self, seconds: float) -> None:
        """Listen for a while, then take the newest state of the arm."""
        self.spend(seconds)
        message = take_latest(self._robot)
        if message is not None:
            self.robot, self._heard['arm'] = message, time.monotonic()

    def silent(self, which: str) -> bool:
        """Whether nothing has come from the ``server`` or the ``arm`` for a while."""
        return time.monotonic() - self._heard[which] > SILENT_S

    def rows(self) -> list[tuple[str, str]]:
        """What there is to see, as words."""
        return [*self._server_rows(), *self._arm_rows()]

    def _server_rows(self) -> list[tuple[str, str]]:
        s = self.state
        if s is None or self.silent('server'):
            return [(self.server, 'silent')]
        left = ', '.join(f'{name} {value:.4g}'
                         for name, value in zip(s.factors, s.distance_to_goal))
        rows = [(self.server, f'{s.status}, {s.progress:.0%}, tempo {s.speed:.2f}'),
                ('skill', s.skill or 'none'), ('distance to goal', left or 'none'),
                ('rate', f'{s.rate_hz:.1f} Hz, {s.missed} of {s.ticks} ticks missed'),
                ('lateness', f'p50 {s.lateness_p50_us:.0f}, p99 {s.lateness_p99_us:.0f}, largest '
                             f'{s.lateness_max_us:.0f} µs ({s.scheduler})')]
        if s.flags:
            rows.append(('flags', ', '.join(s.flags)))
        if s.refused:
            rows.append(('refused', f'{s.refused}, the last: {s.last_refusal}'))
        return rows

    def _arm_rows(self) -> list[tuple[str, str]]:
        r = self.robot
        if r is None or self.silent('arm'):
            return [(self.arm, 'silent')]
        p, v = r.pose.position, r.twist.linear
        stiffness = np.linalg.eigvalsh(np.asarray(r.stiffness).reshape(6, 6)[:3, :3])
        biting = ', '.join(f'{limit.name} by {value:.2g} {limit.unit}'
                           for limit, value in zip(LIMITS, r.limited) if value > 0.0)
        return [(self.arm, f'at {p.x:.3f} {p.y:.3f} {p.z:.3f} m, '
                           f'{np.linalg.norm([v.x, v.y, v.z]):.3f} m/s'),
                ('stiffness', f'{stiffness[0]:.0f} to {stiffness[-1]:.0f} N/m'),
                ('energy tank', f'{r.tank_energy:.2f} J'), ('limited', biting or 'no')]


def watch(server: str, arm: str, seconds: float | None) -> None:
    """
    Show what is going on until Ctrl-C, or for so many seconds.

    :param server: name of a trajectory server, with its namespace
    :param arm: name of the arm's node
    """
    watcher = Watcher(server, arm)
    ends = np.inf if seconds is None else time.monotonic() + seconds
    try:
        if sys.stdout.isatty():
            with Live(console=Console(), refresh_per_second=1.0 / REFRESH_S) as live:
                while time.monotonic() < ends:
                    watcher.look(REFRESH_S)
                    live.update(_view(watcher))
        else:
            while time.monotonic() < ends:
                watcher.look(LINE_S)
                print('; '.join(f'{name}: {text}' for name, text in watcher.rows()), flush=True)
    finally:
        watcher.close()


def _view(watcher: Watcher) -> Group:
    table = Table.grid(padding=(0, 2))
    for name, text in watcher.rows():
        table.add_row(Text(name, style='bold'), Text(text))
    state = watcher.state
    progress = state.progress if state is not None and not watcher.silent('server') else 0.0
    return Group(ProgressBar(total=1.0, completed=min(progress, 1.0), width=60), table)

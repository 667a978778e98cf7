"""A live view of server and arm in the terminal."""
from __future__ import annotations

import math
import sys

from gdmp_msgs.msg import RobotState, ServerState
import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from gdmp_ros.control.limits import described
from gdmp_ros.data.runs import limited
from gdmp_ros.ros.clients.server_client import Client
from gdmp_ros.ros.lifecycle import SILENT_S

#: Interval of the view on a terminal, and of the lines in a pipe or file [s].
REFRESH_S, LINE_S = 0.2, 1.0


class Dashboard(Client):
    """Receives the states of a trajectory server and of an arm."""

    def __init__(self, server: str, arm: str):
        super().__init__('dashboard')
        self.server, self.arm = server, arm
        self.state: ServerState | None = None
        self.robot: RobotState | None = None
        self._received = {'server': -math.inf, 'arm': -math.inf}
        self.subscribe(ServerState, f'{server}/state', self._on_state)
        # At 1 kHz only the newest is used.
        self._robot = self.subscribe(RobotState, f'{arm}/state', depth=1)

    def _on_state(self, message: ServerState) -> None:
        self.state, self._received['server'] = message, self.now()

    def update(self, seconds: float) -> None:
        """Receive messages for a time, then take the newest state of the arm."""
        self.spend(seconds)
        message = self._robot.newest_message()
        if message is not None:
            self.robot, self._received['arm'] = message, self.now()

    def silent(self, which: str) -> bool:
        """Whether the ``server`` or the ``arm`` is silent."""
        return self.now() - self._received[which] > SILENT_S

    def rows(self) -> list[tuple[str, str]]:
        """Rows of the view: name and text."""
        return [*self._server_rows(), *self._arm_rows()]

    def _server_rows(self) -> list[tuple[str, str]]:
        s = self.state
        if s is None or self.silent('server'):
            return [(self.server, 'silent')]
        left = ', '.join(f'{name} {value:.4g}'
                         for name, value in zip(s.factors, s.distance_to_goal))
        rows = [(self.server, f'{s.status}, {min(s.progress, 1.0):.0%}, tempo {s.speed:.2f}'),
                ('skill', s.skill or 'none'), ('distance to goal', left or 'none'),
                ('rate', f'{s.rate_hz:.1f} Hz, {s.missed} of {s.ticks} ticks missed'),
                ('lateness', f'p50 {s.lateness_p50_us:.0f}, p99 {s.lateness_p99_us:.0f}, largest '
                             f'{s.lateness_max_us:.0f} µs ({s.scheduler})')]
        if s.flags:
            rows.append(('flags', ', '.join(s.flags)))
        if s.refused:
            rows.append(('refused', f'{s.refused}, last reason: {s.last_refusal}'))
        return rows

    def _arm_rows(self) -> list[tuple[str, str]]:
        r = self.robot
        if r is None or self.silent('arm'):
            return [(self.arm, 'silent')]
        p, v = r.pose.position, r.twist.linear
        stiffness = np.linalg.eigvalsh(np.asarray(r.stiffness).reshape(6, 6)[:3, :3])
        return [(self.arm, f'at {p.x:.3f} {p.y:.3f} {p.z:.3f} m, '
                           f'{np.linalg.norm([v.x, v.y, v.z]):.3f} m/s'),
                ('stiffness', f'{stiffness[0]:.0f} to {stiffness[-1]:.0f} N/m'),
                ('energy tank', f'{r.tank_energy:.2f} J'),
                ('limited', ', '.join(described(limited(r))) or 'no')]


def show(server: str, arm: str, seconds: float | None) -> None:
    """
    Show the states until Ctrl-C.

    :param server: name of a trajectory server, with its namespace
    :param arm: name of the node of the arm
    :param seconds: duration; None for no end
    """
    dashboard = Dashboard(server, arm)
    ends = np.inf if seconds is None else dashboard.now() + seconds
    try:
        if sys.stdout.isatty():
            with Live(console=Console(), refresh_per_second=1.0 / REFRESH_S) as live:
                while dashboard.now() < ends:
                    dashboard.update(REFRESH_S)
                    live.update(_view(dashboard))
        else:
            while dashboard.now() < ends:
                dashboard.update(LINE_S)
                print('; '.join(f'{name}: {text}' for name, text in dashboard.rows()), flush=True)
    finally:
        dashboard.close()


def _view(dashboard: Dashboard) -> Group:
    table = Table.grid(padding=(0, 2))
    for name, text in dashboard.rows():
        table.add_row(Text(name, style='bold'), Text(text))
    state = dashboard.state
    progress = state.progress if state is not None and not dashboard.silent('server') else 0.0
    return Group(ProgressBar(total=1.0, completed=min(progress, 1.0), width=60), table)

"""Nodes, a recorder and an operator for one trial, each of which may be killed and come back."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
import os
from pathlib import Path
import time
from typing import Any

import numpy as np

from gdmp_ros.data import lasa, runs
from gdmp_ros.data.runs import REFERENCE_TOPIC, STATE_TOPIC
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.experiments.reliability import motion
from gdmp_ros.experiments.reliability.outcome import Outcome
from gdmp_ros.util.processes import ChildProcesses

SIM, SERVER, RECORDER = 'panda_sim', 'trajectory_server', 'recorder'
START_UP_S = 120.0
FRAME = 'panda_link0'


def short_skill(folder: Path, seconds: float = 3.0, name: str = 'GShape') -> Path:
    """Learn a letter of a chosen duration and save it; its file."""
    shown = lasa.robot_demonstrations(name)[0]
    path = folder / f'{name}.json'
    Skill.learn(Demonstration(shown.times * (seconds / shown.duration), shown.points,
                              shown.manifold)).save(path)
    return path


class Trial:
    """The processes of a trial; leaving the context ends them all."""

    def __init__(self, folder: Path, environment: Mapping[str, str], skill: Path):
        """:param environment: of a `gdmp_ros.util.dds_network.Domain`"""
        os.environ.update(environment)  # before rclpy is loaded: this process joins the domain
        from gdmp_ros.ros.clients.server_client import Operator
        self.folder, self.skill = folder, skill
        self.environment = dict(environment)
        self.children = ChildProcesses(environment, folder / 'logs')
        # The recorder may end: it does so when the disk is full.
        self.operator = Operator(check=lambda: self.children.check(but=RECORDER))

    def __enter__(self) -> Trial:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            for name in list(self.children.processes):
                self.children.stop(name)
        finally:
            self.operator.close()

    def start_sim(self, prefix: Sequence[str] = (), extra: Sequence[str] = (),
                  **parameters: object) -> None:
        """Start the simulated arm."""
        self.children.start_node(SIM, 'gdmp_ros.ros.arm.node', parameters, extra, prefix)

    def start_server(self, name: str = SERVER, extra: Sequence[str] = (),
                     environment: Mapping[str, str] | None = None,
                     prefix: Sequence[str] = (), **parameters: object) -> None:
        """Start a trajectory server with the skill."""
        chosen = {'skill': str(self.skill), 'measured_pose_topic': f'/{SIM}/measured_pose',
                  **parameters}
        self.children.start_node(name, 'gdmp_ros.ros.server.node', chosen, extra, prefix,
                                 environment)

    def record(self, bag: Path | None = None, keep_free: float = 64.0,
               prefix: Sequence[str] = ()) -> None:
        """Record references and states until the recorder is stopped."""
        self.children.start(RECORDER, 'gdmp_ros.ros.recorder.record', [
            str(bag or self.folder / 'run'), f'{REFERENCE_TOPIC}=gdmp_msgs/msg/Reference',
            f'{STATE_TOPIC}=gdmp_msgs/msg/RobotState', '--keep-free', str(keep_free)], prefix)
        self.operator.wait('the recorder', lambda: 'recording\n' in self.log(RECORDER), START_UP_S)

    def start(self, sim: Mapping[str, Any] | None = None,
              server: Mapping[str, Any] | None = None) -> None:
        """Start everything and wait until the server holds the arm's pose."""
        self.start_sim(**(sim or {}))
        self.start_server(**(server or {}))
        self.holding()
        self.record()

    @property
    def state(self) -> Any:
        """
        Last state of the server.

        :raises GdmpError: if there is none
        """
        if self.operator.state is None:
            raise GdmpError('the server has not said anything yet')
        return self.operator.state

    def holding(self) -> None:
        """Wait until a server that has just been started holds the arm."""
        self.spend(0.2)  # words of one that is gone may still be on their way
        self.operator.state = None
        self.operator.wait_status('holding', START_UP_S)

    def progress(self, value: float) -> None:
        """Wait for a part of the motion."""
        self.operator.wait(f'{value:.0%} of the motion',
                           lambda: self.state.status == 'moving' and self.state.progress >= value,
                           60.0)

    def spend(self, seconds: float) -> None:
        """Let time pass while the operator listens."""
        self.operator.spend(seconds)

    def succeeded(self, timeout: float = 60.0) -> bool:
        """Wait for the end of the motion; whether it reached its goal."""
        result = self.operator.result(timeout)
        return bool(result.error_code == result.SUCCESSFUL)

    def log(self, name: str) -> str:
        """What a process has said so far."""
        return self.children.log(name).read_text(errors='replace')

    def recorded(self) -> runs.Run:
        """End the recording and read it."""
        self.children.stop(RECORDER, timeout=60.0)
        return runs.read(self.folder / 'run')

    def closing(self, outcome: Outcome, away: float | None = 0.002,
                follows: bool = True) -> runs.Run:
        """
        End the recording and hold it against what every trial asks for.

        :param away: how far from the skill's goal the arm may be at the end [m]; None: anywhere
        :param follows: False where the arm must not follow anything
        """
        run = self.recorded()
        if follows:
            outcome.need('behind the last reference followed [m]', motion.behind(run),
                         lambda v: v < 0.01)
        if away is not None:
            far = float(np.abs(run.poses[-1, :3] - goal_of(self.skill)[:3]).max())
            outcome.need('away from the goal at the end [m]', far, lambda v: v < away)
        outcome.need('references lost', runs.lost(run), lambda v: v == 0)
        motion.judge(run, outcome)
        return run

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        """Call a service and return its reply."""
        return self.operator.call(kind, name, **fields)


def now_ns() -> int:
    """Present wall time, as stamps have it [ns]."""
    return time.time_ns()


def goal_of(skill: Path) -> np.ndarray:
    """Goal pose of a saved skill (x, y, z, qw, qx, qy, qz)."""
    return np.array(Skill.load(skill).goal[:7])

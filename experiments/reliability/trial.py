"""A trial of a fault: a testbed with a skill, and what every recorded run has to fulfil."""
from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.reliability.trial_result import TrialResult
from gdmp_ros.control.guard import NO_REFERENCE
from gdmp_ros.control.settings import LimitSettings
from gdmp_ros.data import lasa, runs
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.robot_watch import RobotSettings
from gdmp_ros.ros.clients.testbed import NodeTestbed, SERVER
from gdmp_ros.sim.arm import Arm

FRAME = 'panda_link0'
#: Largest measured speed relative to the speed limit of the reference: the arm oscillates.
OSCILLATION = 1.1
#: Time in which the arm comes to rest after a motion has reached its goal tolerance [s].
SETTLING_S = 0.5


def short_skill(folder: Path, seconds: float = 3.0, name: str = 'GShape') -> Path:
    """Learn a letter with a given duration, save it, and return its file."""
    shown = lasa.robot_demonstrations(name)[0]
    path = folder / f'{name}.json'
    Skill.learn(Demonstration(shown.times * (seconds / shown.duration), shown.points,
                              shown.manifold)).save(path)
    return path


def goal_of(skill: Path) -> np.ndarray:
    """Goal pose of a saved skill (x, y, z, qw, qx, qy, qz)."""
    return np.array(Skill.load(skill).goal[:7])


def judge_limits(run: runs.Run, outcome: TrialResult) -> None:
    """Require that the arm stayed inside its limits."""
    limits, figures = LimitSettings(), runs.limit_figures(run, Arm().limits)
    for name, value, smallest, largest in (
            ('torque [fraction of the limit]', figures.torque, 0.0, 1.0),
            ('torque rate [Nm per tick]', figures.torque_rate, 0.0,
             1e-3 * limits.torque_slew + 1e-9),
            ('distance to joint limits [rad]', figures.joint_distance, 0.0, np.inf),
            ('joint speed [rad/s]', figures.joint_speed, 0.0, limits.joint_speed),
            ('speed [m/s]', figures.speed, 0.0, OSCILLATION * limits.speed),
            ('smallest energy in the tank [J]', figures.tank_energy, -0.05, np.inf)):
        outcome.need(name, value, partial(_within, smallest, largest))


def _within(smallest: float, largest: float, value: float) -> bool:
    return smallest <= value <= largest


class FaultTrial(NodeTestbed):
    """The nodes of one trial, with a skill for the server."""

    def __init__(self, folder: Path, environment: Mapping[str, str], skill: Path):
        super().__init__(folder, environment)
        self.skill = skill
        self._arm_said = 0

    def start_server(self, name: str = SERVER, *arguments: object, **parameters: object) -> None:
        """Start a trajectory server with the skill; see `NodeTestbed.start_server`."""
        start: Any = super().start_server
        start(name, *arguments, **{'skill': str(self.skill), **parameters})

    def execute(self, goal: Any = None) -> None:
        """Begin a motion; see `gdmp_ros.ros.clients.server_client.ServerClient.execute`."""
        # A trial may begin without an arm.
        self._arm_said = len(self.log(self.arm.node)) if self.arm.node in self.children.processes \
            else 0
        self.client.execute(goal)

    def lost_stream(self) -> bool:
        """
        Whether the arm had no references for longer than it waits, in the last motion.

        It stops then, as it has to: a machine that holds the server up is enough for it.
        """
        return NO_REFERENCE in self.log(self.arm.node)[self._arm_said:]

    def reaches_goal(self, outcome: TrialResult, what: str = 'the motion reaches its goal'
                     ) -> None:
        """
        Require that the motion ends at its goal.

        It is one of speed if the arm lost the stream, or was not there in time; whether it comes
        there at all is judged by `finish`.
        """
        result = self.client.result(60.0)
        reached = result.error_code == result.SUCCESSFUL
        outcome.claim(what if reached else f'{what} ({result.error_string})', reached,
                      result.error_code == result.GOAL_TOLERANCE_VIOLATED or self.lost_stream())

    def stays_and_begins_again(self, outcome: TrialResult) -> None:
        """
        Require that a motion that was lost is reported, and the next one reaches the goal.

        A fault that ends before the arm has left the reference loses no motion: then the arm has
        to be at the goal.
        """
        result = self.client.result(60.0)
        outcome.measured['the motion ended with'] = result.error_string or 'success'
        if result.error_code == result.SUCCESSFUL:
            self.spend(SETTLING_S)
            distance, largest = self.state.robot_distance, RobotSettings()
            outcome.claim('only a motion that reached its goal is called reached',
                          len(distance) == 2 and distance[0] < largest.robot_position_tolerance
                          and distance[1] < largest.robot_rotation_tolerance)
        else:
            outcome.claim('the lost motion is reported as lost',
                          result.error_code in (result.BLOCKED, result.GOAL_TOLERANCE_VIOLATED))
        self.wait('the robot', lambda: 'no_robot' not in self.state.flags, 60.0)
        self.execute()
        self.reaches_goal(outcome, 'the next motion reaches its goal')

    def finish(self, outcome: TrialResult, distance: float | None = 0.002,
               follows: bool = True) -> runs.Run:
        """
        End the recording, and require what every trial has to fulfil.

        :param distance: largest final distance from the goal of the skill [m]; None for any
        :param follows: False if the arm must not follow anything
        """
        if follows:
            self.spend(SETTLING_S)
        run = self.recorded()
        if follows:
            outcome.need('final distance from the last reference [m]',
                         runs.final_distance(run), lambda v: v < 0.01, self.lost_stream())
        if distance is not None:
            final = float(np.abs(run.poses[-1, :3] - goal_of(self.skill)[:3]).max())
            outcome.need('final distance from the goal [m]', final, lambda v: v < distance,
                         self.lost_stream())
        # By the recorder, too, which has no real-time priority: its history is five seconds.
        outcome.need('references lost', runs.lost(run), lambda v: v == 0, of_speed=True)
        judge_limits(run, outcome)
        return run

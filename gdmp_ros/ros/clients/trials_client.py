"""Roll-outs of skills on the robot of running nodes: executed, recorded, ended at a limit."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from gdmp_msgs.msg import ArmStatus, Reference, RobotState
from gdmp_msgs.srv import LoadSkill
import numpy as np
from std_srvs.srv import Trigger

from gdmp_ros.control.limits import TORQUE_RATE
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.data.bags import ns_of, vector_numbers
from gdmp_ros.data.runs import limited
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.improvement.trial import BACK_SPEED, problem, refused, REMEMBER_EVERY, Trial
from gdmp_ros.ros.clients.arm_client import move_joints
from gdmp_ros.ros.clients.server_client import ServerClient
from gdmp_ros.ros.messages import NS, pose_numbers
from gdmp_ros.ros.middleware import DEEP, Subscription
from gdmp_ros.util.terminal import progress, rising

#: Time in which an arm comes to rest [s].
REST_S = 5.0
#: Beyond this an arm is not where roll-outs begin [rad].
THERE = 0.02
#: Time beyond that of the skill in which a motion must end [s].
LONGER_S = 60.0
#: Time between two reports of an arm, and a margin [s].
REPORT_S = 0.3
#: Problem of an arm that stopped, until it says why.
LEFT = 'the arm no longer follows'


class _Row(NamedTuple):
    """What a trial keeps of a state of the arm."""

    stamp: int
    sequence: int
    measured: np.ndarray
    stiffness: np.ndarray
    wrench: np.ndarray
    joints: np.ndarray
    torque: np.ndarray


class TrialsClient(ServerClient):
    """
    Executes skills from the same posture; see `gdmp_ros.improvement.trial.Robot`.

    The limits of the nodes act in any case; a roll-out that reaches one is ended too.
    """

    def __init__(self, server: str, arm: str, largest_force: float = np.inf):
        """
        Connect.

        :param server: name of the trajectory server, with its namespace
        :param arm: name of the node of the arm
        :param largest_force: at which a roll-out is ended [N]
        """
        self._polled: list[tuple[Subscription, Callable[[Any], None]]] = []
        super().__init__(server, self._read)
        self._server, self._arm = server, arm
        self._largest_force = largest_force
        self._robot: RobotState | None = None
        self._status: ArmStatus | None = None
        self._start = np.empty(0)
        self._trial: Trial | None = None
        self._rows: list[_Row] = []
        self._references: dict[int, np.ndarray] = {}
        self._problem, self._refused, self._recording = '', 0, False
        for kind, topic, callback in ((Reference, f'{server}/reference', self._on_reference),
                                      (RobotState, f'{arm}/state', self._on_robot)):
            # An executor is too slow for 1 kHz.
            self._polled.append((self.subscribe(kind, topic, depth=DEEP), callback))
        self.subscribe(ArmStatus, f'{arm}/status', self._on_status)

    def begin_at(self, posture_at: Callable[[np.ndarray], np.ndarray], timeout: float) -> None:
        """
        Say where roll-outs begin.

        :param posture_at: present positions of the joints -> those at the start of the skill [rad]
        :param timeout: for the nodes [s]
        :raises GdmpError: if a node is silent
        """
        self.wait(f'{self._arm} and {self._server}', lambda: (
            self._robot is not None and self._status is not None and self.state is not None),
            timeout)
        self._start = posture_at(self._position())

    def perform(self, skill: Skill) -> Trial:
        """Go to where roll-outs begin, and execute a skill."""
        if not len(self._start):
            raise GdmpError('it is not known where roll-outs begin')
        self.spend(REPORT_S)  # what came while a person was asked
        if np.abs(self._position() - self._start).max() > THERE:
            self._rest()
            move_joints(self, self._arm, self._start.tolist(), BACK_SPEED)
        warning = self.request(LoadSkill, f'{self._server}/load_skill', path='candidate',
                               contents=skill.text())
        self._trial = None
        if warning:
            return refused(f'not begun: {warning}', len(self._position()))
        # Every roll-out begins with the same energy.
        self.request(Trigger, f'{self._arm}/refill_tank')
        self._forget()
        self._refused = self._status.refused if self._status is not None else 0
        self._recording = True
        try:
            self._execute(skill.duration)
        finally:
            self._recording = False
        self._trial = self._recorded()
        return self._trial

    def go_back(self) -> None:
        """Go back the way it came, to where roll-outs begin."""
        trial = self._trial
        if trial is None or not len(trial.joints):
            return
        self._rest()
        move_joints(self, self._arm, self._start.tolist(), BACK_SPEED,
                    trial.joints[::-REMEMBER_EVERY])
        self._trial = None

    def _execute(self, seconds: float) -> None:
        """Execute until the end, or until something is wrong."""
        with progress('executing, seconds', round(seconds)) as step:
            self.execute()
            show, left = rising(step), seconds + LONGER_S
            try:
                while not self.done() and not self._problem:
                    self.spend(0.02)
                    left -= 0.02
                    if left < 0.0:
                        self._problem = f'no end after {seconds + LONGER_S:.0f} s'
                    show(seconds * min(self.state.progress if self.state else 0.0, 1.0))
            finally:
                # Also after Ctrl-C.
                self.cancel()
        result = self.result(REST_S + LONGER_S)
        if not self._problem and result.error_code not in (
                result.SUCCESSFUL, result.GOAL_TOLERANCE_VIOLATED):
            self._problem = result.error_string
        if self._problem == LEFT:
            self.spend(REPORT_S)  # until the arm has said why
            status = self._status
            self._problem = (status.reason or status.last_refusal if status else '') or LEFT

    def _rest(self) -> None:
        """
        Let the arm hold, and not follow references any more.

        :raises GdmpError: if it does not
        """
        self.request(Trigger, f'{self._arm}/stop')
        self._robot = None
        self.wait(f'{self._arm} to hold', lambda: (
            self._robot is not None and self._robot.mode == ArmMode.HOLD), REST_S)

    def _position(self) -> np.ndarray:
        if self._robot is None:
            raise GdmpError(f'{self._arm} is silent')
        return np.array(self._robot.position)

    # What is received

    def _forget(self) -> None:
        self._rows.clear()
        self._references.clear()
        self._problem = ''

    def _read(self) -> None:
        for subscription, callback in self._polled:
            while (message := subscription.take_message()) is not None:
                callback(message)

    def _on_reference(self, message: Reference) -> None:
        if self._recording and message.mode == StreamMode.STREAMING:
            self._references[message.sequence] = pose_numbers(message.pose)

    def _on_robot(self, message: RobotState) -> None:
        self._robot = message
        if not self._recording or self._problem:
            return
        if message.mode != ArmMode.FOLLOW:
            if self._rows and not self.done():
                self._problem = LEFT
            return
        stamp, force = message.header.stamp, message.wrench
        self._rows.append(_Row(
            ns_of(stamp), message.sequence, pose_numbers(message.pose),
            np.array(message.stiffness), np.array(vector_numbers(force.force, force.torque)),
            np.array(message.position), np.array(message.torque)))
        violation = limited(message)
        # References arrive with jitter: this limit acts in every motion, and only smooths.
        violation[TORQUE_RATE] = 0.0
        self._problem = problem(violation, message.tank_energy, self._rows[-1].wrench,
                                self._largest_force)

    def _on_status(self, message: ArmStatus) -> None:
        self._status = message
        if self._recording and not self._problem and message.refused > self._refused:
            self._problem = message.reason or message.last_refusal

    def _recorded(self) -> Trial:
        """The trial, with a row for each state whose reference is known."""
        rows, known = self._rows, sorted(self._references)
        if not rows or not known:
            raise GdmpError(f'{self._arm} did not follow: {self._problem or "no reason is known"}')
        # A reference is followed until the next one; the last one also while the arm settles.
        at = np.searchsorted(known, [row.sequence for row in rows], side='right') - 1
        rows = [row for row, k in zip(rows, at) if k >= 0]
        references = np.array([self._references[known[k]] for k in at if k >= 0])
        stamps, _, measured, stiffness, wrenches, joints, torques = map(np.array, zip(*rows))
        return Trial((stamps - stamps[0]) / NS, references, measured,
                     stiffness.reshape(-1, 6, 6), wrenches, joints, torques, np.empty(0),
                     self._problem)


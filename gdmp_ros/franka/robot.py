"""Access to a Franka robot: measure, command, recover."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
import socket
import time
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.settings import BETWEEN_CLIENTS_S, FrankaSettings, JOINTS, PORT
from gdmp_ros.realtime.loop import Clock, SystemClock
from gdmp_ros.sim.frames import pose_of, ToolTransform
from gdmp_ros.sim.payload import Payload
from gdmp_ros.util.optional_imports import extra, optional_import

with optional_import(extra('franka')):
    import pylibfranka as libfranka

#: Time to answer a connection [s].
ANSWER_S = 1.0
#: What the binding raises; it knows no common base of these.
FAILURES = (libfranka.ControlException, libfranka.CommandException, libfranka.NetworkException,
            libfranka.InvalidOperationException, libfranka.RealtimeException,
            libfranka.FrankaException)


def opened(host: str, config: Any) -> Any:
    """
    Connect to a robot; libfranka alone would wait for minutes, and keep the interpreter.

    :param config: whether real-time priority is required
    :raises ArmStopped: if nobody answers
    """
    try:
        socket.create_connection((host, PORT), timeout=ANSWER_S).close()
    except OSError as error:
        raise ArmStopped(f'{host}: the robot does not answer: {error.strerror or error}', False
                           ) from None
    time.sleep(BETWEEN_CLIENTS_S)
    return libfranka.Robot(host, config)


@contextmanager
def own_priority() -> Iterator[None]:
    """
    Keep the priority of the calling thread.

    libfranka gives it the highest one, for ever: the threads that it starts would inherit it, and
    stop all others of the machine.
    """
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        yield
    finally:
        if (os.sched_getscheduler(0), os.sched_getparam(0)) != (policy, parameters):
            os.sched_setscheduler(0, policy, parameters)


class Reading(NamedTuple):
    """
    State of the robot at one cycle, and its own model in that state.

    :ivar position: of the joints [rad]
    :ivar velocity: [rad/s]
    :ivar external: torque that the robot attributes to the environment [Nm]
    :ivar jacobian: of the end effector, linear over angular, shape ``(6, 7)``
    :ivar inertia: in joint space, with end effector and load, without rotors [kg m²]
    :ivar coriolis: Coriolis torque [Nm]
    :ivar elapsed: time since the last cycle of this control, 0 at its first [s]
    """

    position: np.ndarray
    velocity: np.ndarray
    external: np.ndarray
    jacobian: np.ndarray
    inertia: np.ndarray
    coriolis: np.ndarray
    elapsed: float


class FrankaRobot:
    """
    One robot; only one thread at a time may use it.

    Torques are without gravity and the friction that the robot compensates itself.

    :ivar arrived: when the last state arrived, steady time [ns]
    """

    def __init__(self, settings: FrankaSettings, clock: Clock | None = None,
                 opened: Callable[[str, Any], Any] = opened):
        """
        Connect, and tell the robot its thresholds.

        :param clock: of `arrived`; by default that of the system
        :param opened: connects to a robot
        :raises ArmStopped: if the robot does not answer
        """
        self._settings, self._explained = settings, _Explained(settings.host, self._end)
        self._clock, self._opened = clock or SystemClock(), opened
        self.arrived = 0
        self._robot: Any = None
        self._control: Any = None
        self._state: Any = None
        self._model: Any = None
        self.connect()

    @property
    def connected(self) -> bool:
        """Whether the robot answers."""
        return self._robot is not None

    @property
    def controlled(self) -> bool:
        """Whether torques are sent."""
        return self._control is not None

    @property
    def seconds(self) -> float:
        """Time of the robot at the last state [s]."""
        return float(self._state.time.to_sec())

    @property
    def position(self) -> np.ndarray:
        """Position of the end effector, as the robot says [m]."""
        return np.array(self._state.O_T_EE[12:15])

    @property
    def end_effector(self) -> ToolTransform:
        """Where the end effector is, in the frame of the flange."""
        x, y, z, *turn = pose_of(np.array(self._state.F_T_EE).reshape(4, 4).T).tolist()
        w, i, j, k = turn
        return ToolTransform((x, y, z), (w, i, j, k))

    @property
    def success_rate(self) -> float:
        """Share of the last hundred cycles whose command arrived in time."""
        return float(self._state.control_command_success_rate)

    def connect(self) -> None:
        """
        Connect again.

        :raises ArmStopped: if the robot does not answer
        """
        settings = self._settings
        if not settings.host:
            raise ParameterError('host is empty, expected the address of the robot')
        realtime = libfranka.RealtimeConfig
        config = realtime.kEnforce if settings.enforce_realtime else realtime.kIgnore
        self._robot = self._control = None
        with self._explained, own_priority():
            self._robot = self._opened(settings.host, config)
            torques, wrench = settings.joint_thresholds, settings.wrench_thresholds
            self._robot.set_collision_behavior(torques, torques, wrench, wrench)
            self._model = self._robot.load_model()
            self._state = self._robot.read_once()

    def carry(self, payload: Payload) -> None:
        """
        Tell the robot what it carries, without the end effector; only while it is not controlled.

        :param payload: in the frame of the end effector
        :raises ArmStopped: if the robot does not answer
        """
        if self._robot is None:
            raise ArmStopped(f'{self._settings.host}: the robot does not answer', False)
        # Zero, too: otherwise the robot keeps the load of the last run.
        load = payload.seen_from(self.end_effector)
        with self._explained:
            self._robot.set_load(load.mass, list(load.center), load.matrix.ravel().tolist())

    def begin(self) -> None:
        """
        Begin torque control.

        :raises ArmStopped: if the robot refuses
        """
        with self._explained, own_priority():
            self._control = self._robot.start_torque_control()

    def read(self) -> Reading:
        """
        Wait for the next state.

        :raises ArmStopped: if the robot has ended the control
        """
        elapsed = 0.0
        with self._explained:
            if self._control is None:
                self._state = self._robot.read_once()
            else:
                self._state, duration = self._control.readOnce()
                elapsed = duration.to_sec()
        self.arrived = self._clock.now()
        state, model = self._state, self._model
        # libfranka stores matrices column by column.
        return Reading(
            np.array(state.q), np.array(state.dq), np.array(state.tau_ext_hat_filtered),
            np.array(model.zero_jacobian(state)).reshape(JOINTS, 6).T,
            np.array(model.mass(state)).reshape(JOINTS, JOINTS), np.array(model.coriolis(state)),
            elapsed)

    def write(self, torque: np.ndarray, last: bool = False) -> None:
        """
        Answer the last state.

        :param torque: [Nm]
        :param last: end the control; the robot then holds its position by itself
        :raises ArmStopped: if the robot has ended the control
        """
        if self._control is None:
            raise ArmStopped(f'{self._settings.host}: the robot is not controlled', True)
        command = libfranka.Torques(torque.tolist())
        command.motion_finished = last
        with self._explained:
            self._control.writeOnce(command)
        if last:
            self._control = None

    def recover(self) -> None:
        """
        End a reflex, connect again where that is necessary.

        :raises ArmStopped: if the robot does not answer, or does not recover
        """
        if self._robot is None:
            self.connect()
        with self._explained:
            self._robot.automatic_error_recovery()
            self._state = self._robot.read_once()

    def close(self) -> None:
        """Disconnect."""
        self._robot = self._control = None

    def _end(self, connected: bool) -> None:
        self._control = None
        if not connected:
            self._robot = None


class _Explained:
    """Context that says what libfranka reports."""

    def __init__(self, host: str, end: Callable[[bool], None]):
        """:param end: called with whether the robot still answers, if it has ended the control"""
        self._host, self._end = host, end

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if not isinstance(error, FAILURES):
            return
        connected = not isinstance(error, libfranka.NetworkException)
        what = ('the robot does not answer' if not connected else 'no real-time priority'
                if isinstance(error, libfranka.RealtimeException) else 'the robot has stopped')
        self._end(connected)
        raise ArmStopped(f'{self._host}: {what}: {_text(error)}', connected) from None


def _text(error: Exception) -> str:
    return str(error).removeprefix('libfranka: ').strip()

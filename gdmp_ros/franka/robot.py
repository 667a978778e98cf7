"""Access to a Franka robot: measure, command, recover."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.errors import ParameterError
from gdmp_ros.franka.channel import (
    Channel,
    channel_since,
    CYCLE_S,
    datagram_sockets,
    MOVES,
)
from gdmp_ros.franka.greeting import ANSWER_S, check_answers
from gdmp_ros.franka.settings import FrankaSettings, JOINTS
from gdmp_ros.sim.frames import pose_of, ToolTransform
from gdmp_ros.sim.payload import moments_of, Payload
from gdmp_ros.util.optional_imports import extra, optional_import

with optional_import(extra('franka')):
    import pylibfranka as libfranka

#: Time without a state after which a robot does not answer [s].
PATIENCE_S = 1.0
#: What the binding raises; it knows no common base of these.
FAILURES = (libfranka.ControlException, libfranka.CommandException, libfranka.NetworkException,
            libfranka.InvalidOperationException, libfranka.RealtimeException,
            libfranka.FrankaException)


def opened(host: str, config: Any) -> tuple[Any, Channel]:
    """
    Connect to a robot.

    :param config: whether real-time priority is required
    :returns: the connection, and its real-time channel
    :raises ArmStopped: if nobody answers
    """
    check_answers(host)
    before = datagram_sockets()
    robot = libfranka.Robot(host, config)
    return robot, channel_since(before, ANSWER_S)


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
    State of the robot at one cycle.

    :ivar position: of the joints [rad]
    :ivar velocity: [rad/s]
    :ivar external: torque that the robot attributes to the environment [Nm]
    :ivar taken: lowest and highest torque with which it may compare the next [Nm]
    :ivar elapsed: time since the last cycle of this control, 0 at its first [s]
    """

    position: np.ndarray
    velocity: np.ndarray
    external: np.ndarray
    taken: np.ndarray
    elapsed: float


class OwnModel(NamedTuple):
    """
    The robot's own model in a state.

    :ivar position: of the joints [rad]
    :ivar jacobian: of the end effector, linear over angular, shape ``(6, 7)``
    :ivar inertia: in joint space, with end effector and load, without rotors [kg m²]
    """

    position: np.ndarray
    jacobian: np.ndarray
    inertia: np.ndarray


class FrankaRobot:
    """
    One robot; only one thread at a time may use it.

    Torques are without gravity and the friction that the robot compensates itself.

    :ivar channel: through which states and commands go; after a robot has gone, its last state
    """

    def __init__(self, settings: FrankaSettings,
                 opened: Callable[[str, Any], tuple[Any, Channel]] = opened):
        """
        Connect, and tell the robot its thresholds.

        :param opened: connects to a robot
        :raises ArmStopped: if the robot does not answer
        """
        self._settings, self._explained = settings, _Explained(settings.host, self._end)
        self._opened = opened
        self.channel = Channel()
        self._robot: Any = None
        self._control: Any = None
        self._model: Any = None
        self._begun = False
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
        return CYCLE_S * self.channel.number

    @property
    def position(self) -> np.ndarray:
        """Position of the end effector, as the robot says [m]."""
        return self.channel.part('O_T_EE')[12:15]

    @property
    def end_effector(self) -> ToolTransform:
        """Where the end effector is, in the frame of the flange."""
        # libfranka stores matrices column by column.
        x, y, z, *turn = pose_of(self.channel.part('F_T_EE').reshape(4, 4).T).tolist()
        w, i, j, k = turn
        return ToolTransform((x, y, z), (w, i, j, k))

    @property
    def tool_moments(self) -> np.ndarray:
        """Mass of the end effector in the frame of the flange, as `Payload.moments`."""
        return moments_of(float(self.channel.part('m_ee')[0]), self.channel.part('F_x_Cee'),
                          self.channel.part('I_ee').reshape(3, 3))

    @property
    def success_rate(self) -> float:
        """Share of the last hundred cycles whose command arrived in time."""
        return self.channel.success_rate

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
            self._robot, self.channel = self._opened(settings.host, config)
            torques, wrench = settings.joint_thresholds, settings.wrench_thresholds
            self._robot.set_collision_behavior(torques, torques, wrench, wrench)
            self._model = self._robot.load_model()
        self.read()

    def own_model(self) -> OwnModel:
        """
        Ask the robot's own model; only while it is not controlled.

        :raises ArmStopped: if the robot does not answer
        """
        robot = self._present()
        with self._explained:
            state, model = robot.read_once(), self._model
            return OwnModel(np.array(state.q),
                            np.array(model.zero_jacobian(state)).reshape(JOINTS, 6).T,
                            np.array(model.mass(state)).reshape(JOINTS, JOINTS))

    def carry(self, payload: Payload) -> None:
        """
        Tell the robot what it carries, without the end effector; only while it is not controlled.

        :param payload: in the frame of the end effector
        :raises ArmStopped: if the robot does not answer
        """
        robot = self._present()
        # Zero, too: otherwise the robot keeps the load of the last run.
        load = payload.seen_from(self.end_effector)
        with self._explained:
            robot.set_load(load.mass, list(load.center), load.matrix.ravel().tolist())

    def begin(self) -> None:
        """
        Begin torque control.

        :raises ArmStopped: if the robot refuses
        """
        robot = self._present()
        with self._explained, own_priority():
            self._control = robot.start_torque_control()
        self.channel.begin()
        self._begun = True

    def read(self) -> Reading:
        """
        Wait for the next state.

        :raises ArmStopped: if the robot has ended the control, or does not answer
        """
        channel = self.channel
        if self._robot is None or not channel.receive(PATIENCE_S):
            self._end(False)
            raise ArmStopped(f'{self._settings.host}: the robot does not answer: no state within '
                             f'{PATIENCE_S:g} s', False)
        if self._control is not None and channel.mode != MOVES:
            self._ask_why()
        first, self._begun = self._begun or self._control is None, False
        return self._reading(0.0 if first else CYCLE_S * channel.passed, channel.taken())

    def last(self) -> Reading:
        """The last state again, after kernels have taken some."""
        wire = self.channel.wire
        return self._reading(CYCLE_S, np.array([wire.lowest, wire.highest]))

    def _reading(self, elapsed: float, taken: np.ndarray) -> Reading:
        channel = self.channel
        return Reading(channel.part('q'), channel.part('dq'), channel.part('tau_ext_hat_filtered'),
                       taken, elapsed)

    def _ask_why(self) -> None:
        """:raises ArmStopped: with why the robot has ended the control"""
        with self._explained:
            self._control.readOnce()
        self._control = None
        raise ArmStopped(f'{self._settings.host}: the robot has ended the control', True)

    def write(self, torque: np.ndarray, last: bool = False) -> None:
        """
        Answer the last state.

        :param torque: [Nm]
        :param last: end the control; the robot then holds its position by itself
        :raises ArmStopped: if the robot has ended the control
        """
        if self._control is None:
            raise ArmStopped(f'{self._settings.host}: the robot is not controlled', True)
        self.channel.send(torque)
        if last:
            command = libfranka.Torques(torque.tolist())
            command.motion_finished = True
            with self._explained:
                self._control.readOnce()
                self._control.writeOnce(command)
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

    def close(self) -> None:
        """Disconnect."""
        self._robot = self._control = None

    def _present(self) -> Any:
        """:raises ArmStopped: if the robot has gone"""
        if self._robot is None:
            raise ArmStopped(f'{self._settings.host}: the robot does not answer', False)
        return self._robot

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

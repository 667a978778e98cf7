"""
A Franka Research 3 at the other end of libfranka, in lockstep: it moves on when a command arrives.

It has the methods of pylibfranka, an arm in MuJoCo with dry friction, and ends a motion for the
reasons that the robot has: commands that do not arrive, torques that jump or are too large.
"""
from types import SimpleNamespace

import mujoco
import numpy as np
import pylibfranka as libfranka

from gdmp_ros.franka.robot import RobotStopped
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.plant import PlantSettings

CYCLE_NS, NS = 1_000_000, 1_000_000_000
#: Commands that may fail to arrive one after the other.
LOST_CYCLES = 20
#: Largest change of a torque between two commands [Nm], and largest torques [Nm].
TORQUE_STEP, TORQUE = 1.0, np.array([87.0] * 4 + [12.0] * 3)
#: Dry friction of the joints in public models of the robot [Nm].
DRY_FRICTION = 1.137
#: Posture of a robot that has just been switched on [rad].
FIRST = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.5, 0.6])
#: libfranka gives up waiting for a state after this time [ns].
PATIENCE_NS = NS


class StandIn:
    """
    The robot.

    :ivar aborted: why it has ended motions
    """

    def __init__(self, clock, dry_friction=DRY_FRICTION):
        self.clock, self._friction = clock, dry_friction
        self._known = Arm('fr3', 'flange', hand=False)
        self._model = self._known.known.model
        self._data = mujoco.MjData(self._model)
        self.load = None
        self.start()

    def start(self):
        """Switch on: it stands at its first posture."""
        self.arm = Arm('fr3', 'flange', hand=False, plant=PlantSettings(
            dry_friction=self._friction))
        self.arm.reset(FIRST)
        self.alive, self.reachable, self.error = True, True, ''
        self.aborted, self.control, self.ticks = [], None, 0
        self._begun = self.clock.now()

    def kill(self):
        """Switch off."""
        self.alive, self.control = False, None

    def cut(self):
        """Nothing gets through the cable."""
        self.reachable = False

    def join(self):
        """The cable is whole again; the robot has ended its motion meanwhile."""
        self.reachable = True
        if self.control is not None:
            self.abort('communication_constraints_violation')

    def abort(self, reason):
        """End the motion."""
        self.error, self.control = reason, None
        self.aborted.append(reason)

    def open(self, host, config):
        """See `gdmp_ros.franka.robot.opened`."""
        if not (self.alive and self.reachable):
            raise RobotStopped(f'{host}: the robot does not answer: Connection refused', False)
        return Robot(self)

    def dynamics(self, position, velocity):
        """Inertia without rotors, gravity and Coriolis torques."""
        data = self._data
        data.qpos[:], data.qvel[:] = position, 0.0
        mujoco.mj_forward(self._model, data)
        gravity = data.qfrc_bias.copy()
        data.qvel[:] = velocity
        mujoco.mj_fwdVelocity(self._model, data)
        inertia = np.zeros((7, 7))
        mujoco.mj_fullM(self._model, data, inertia)
        return (inertia - np.diag(self._model.dof_armature), gravity,
                data.qfrc_bias - gravity)

    def jacobian(self, position):
        """Of the flange, shape ``(6, 7)``."""
        self._known.reset(position)
        return self._known.measure().jacobian.copy()

    def move(self, torque):
        """Let a torque above gravity act for a cycle."""
        position = self.arm.data.qpos.copy()
        _, gravity, _ = self.dynamics(position, np.zeros(7))
        self.arm.step(torque + gravity)
        self.ticks += 1

    def state(self):
        """What it reports."""
        still = self.control is None
        position = self.arm.data.qpos.copy()
        if still:
            self.arm.data.qvel[:] = 0.0  # the brakes
        pose = np.eye(4)
        pose[:3, 3] = self._known.pose_at(position)[:3]
        return SimpleNamespace(
            q=position.tolist(), dq=self.arm.data.qvel.tolist(), tau_ext_hat_filtered=[0.0] * 7,
            O_T_EE=pose.T.ravel().tolist(), F_T_EE=np.eye(4).T.ravel().tolist(),
            time=libfranka_time((self.clock.now() - self._begun) / NS),
            control_command_success_rate=1.0)


def libfranka_time(seconds):
    return SimpleNamespace(to_sec=lambda: seconds)


class Robot:
    """A connection to it; see ``pylibfranka.Robot``."""

    def __init__(self, robot):
        self._robot, self._begun = robot, robot._begun

    def check(self):
        robot = self._robot
        if not robot.reachable:
            robot.clock.sleep_until(robot.clock.now() + PATIENCE_NS)
        if not (robot.alive and robot.reachable and robot._begun == self._begun):
            raise libfranka.NetworkException('libfranka: UDP receive: Timeout')

    def set_collision_behavior(self, *thresholds):
        self.check()
        assert [len(one) for one in thresholds] == [7, 7, 6, 6]

    def set_load(self, mass, center, inertia):
        self.check()
        assert len(center) == 3 and len(inertia) == 9
        if self._robot.control is not None:
            raise libfranka.CommandException('libfranka: set_load: Command not possible in the '
                                             'current mode')
        self._robot.load = mass, center, inertia

    def load_model(self):
        self.check()
        return Model(self._robot)

    def read_once(self):
        clock = self._robot.clock
        clock.sleep_until((clock.now() // CYCLE_NS + 1) * CYCLE_NS)
        self.check()
        return self._robot.state()

    def automatic_error_recovery(self):
        self.check()
        self._robot.error = ''

    def start_torque_control(self):
        self.check()
        robot = self._robot
        if robot.error:
            raise libfranka.CommandException('libfranka: Move command rejected: command not '
                                             f'possible in the current mode ("Reflex"): '
                                             f'{robot.error}')
        robot.control = Control(self, robot)
        return robot.control


class Model:
    """See ``pylibfranka.Model``; matrices are stored column by column."""

    def __init__(self, robot):
        self._robot = robot

    def zero_jacobian(self, state):
        return self._robot.jacobian(np.array(state.q)).T.ravel().tolist()

    def mass(self, state):
        return self._robot.dynamics(state.q, state.dq)[0].ravel().tolist()

    def coriolis(self, state):
        return self._robot.dynamics(state.q, state.dq)[2].tolist()


class Control:
    """See ``pylibfranka.ActiveControlBase``."""

    def __init__(self, connection, robot):
        self._connection, self._robot, self._torque = connection, robot, np.zeros(7)
        self._read = 0
        self._commanded = robot.clock.now()

    def _check(self):
        self._connection.check()
        robot = self._robot
        lost = (robot.clock.now() - self._commanded) // CYCLE_NS
        if robot.control is self and lost > LOST_CYCLES:
            robot.abort('communication_constraints_violation')
        if robot.control is not self:
            raise libfranka.ControlException(
                f'libfranka: Move command aborted: motion aborted by reflex! ["{robot.error}"]')

    def readOnce(self):  # noqa: N802
        clock = self._robot.clock
        clock.sleep_until((clock.now() // CYCLE_NS + 1) * CYCLE_NS)
        self._check()
        elapsed = (clock.now() - self._read) / NS if self._read else 0.0
        self._read = clock.now()
        return self._robot.state(), libfranka_time(elapsed)

    def writeOnce(self, command):  # noqa: N802
        self._check()
        robot, torque = self._robot, np.array(command.tau_J)
        if np.abs(torque - self._torque).max() > TORQUE_STEP + 1e-9:
            robot.abort('controller_torque_discontinuity')
            return
        if not np.isfinite(torque).all() or (np.abs(torque) > TORQUE).any():
            robot.abort('tau_j_range_violation')
            return
        # What a client leaves out acts as before.
        for _ in range(max((robot.clock.now() - self._commanded) // CYCLE_NS, 1)):
            robot.move(torque)
        self._torque, self._commanded = torque, robot.clock.now()
        if command.motion_finished:
            robot.control = None

"""
A Franka Research 3 at the other end of libfranka, in lockstep: it moves on when a command arrives.

It has the methods of pylibfranka, a real-time channel with the robot's packed states, an arm in
MuJoCo with dry friction, and ends a motion for the reasons that the robot has: commands that do
not arrive, torques that jump or are too large. Its hand is one as well.
"""
import functools
from types import SimpleNamespace

import mujoco
import numpy as np
import pylibfranka as libfranka

from gdmp_ros.control.arm_driver import ArmStopped
from gdmp_ros.franka.channel import ARRIVED, ARRIVED_BEFORE, BEFORE, Channel, MOVES, NUMBER
from gdmp_ros.ros.arm_choice import HAND
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
#: How far the fingers open [m], and the tool between them, in the frame of the flange.
WIDEST = 0.08
TOOL = np.array([*HAND['tool_position'], *HAND['tool_rotation']])


class StandIn:
    """
    The robot.

    :ivar aborted: why it has ended motions
    :ivar object_width: of what is between the fingers, 0 if there is nothing [m]
    """

    def __init__(self, clock, dry_friction=DRY_FRICTION):
        self.clock, self._friction = clock, dry_friction
        self._known = Arm('fr3')
        self._model = self._known.model
        self._data, self._site = mujoco.MjData(self._model), self._model.site('tcp').id
        self._computed = None, None
        self.load, self.object_width, self.width = None, 0.0, WIDEST
        self.start()

    def start(self):
        """Switch on: it stands at its first posture."""
        self.arm = Arm('fr3', plant=PlantSettings(dry_friction=self._friction))
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
            raise ArmStopped(f'{host}: the robot does not answer: Connection refused', False)
        self.control = None  # the motion of a client that has gone has ended with its connection
        connection = Robot(self)
        return connection, LockstepChannel(connection)

    def open_hand(self, host):
        """See `gdmp_ros.franka.gripper.opened`."""
        made = Hand(self)
        made.check()
        return made

    def dynamics(self, position, velocity):
        """Inertia without rotors, gravity and Coriolis torques."""
        state = np.concatenate([position, velocity])
        if self._computed[0] is None or (state != self._computed[0]).any():
            self._computed = state, self._dynamics(position, velocity)
        return self._computed[1]

    def _dynamics(self, position, velocity):
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = position, 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        inertia, gravity, bias = np.zeros((7, 7)), np.zeros(7), np.zeros(7)
        mujoco.mj_fullM(model, data, inertia)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, gravity)
        data.qvel[:] = velocity
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 0, bias)
        return inertia - np.diag(model.dof_armature), gravity, bias - gravity

    def jacobian(self, position):
        """Of the tool, shape ``(6, 7)``."""
        data, site = self._data, self._site
        data.qpos[:] = position
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        jacobian = np.empty((6, 7))
        mujoco.mj_jacSite(self._model, data, jacobian[:3], jacobian[3:], site)
        return jacobian

    def move(self, torque):
        """Let a torque above gravity act for a cycle."""
        data = self.arm.data
        _, gravity, _ = self.dynamics(data.qpos, data.qvel)
        self.arm.step(torque + gravity)
        self.ticks += 1

    def state(self):
        """What it reports, as libfranka does."""
        if self.control is None:
            self.arm.data.qvel[:] = 0.0  # the brakes
        return SimpleNamespace(q=self.arm.data.qpos.tolist(), dq=self.arm.data.qvel.tolist())

    def report(self, channel):
        """Write what it reports into the memory of a channel."""
        state, (mass, center, inertia) = self.state(), self.hand_mass
        for name, numbers in (
                ('q', state.q), ('dq', state.dq), ('tau_ext_hat_filtered', np.zeros(7)),
                ('O_T_EE', column_by_column(self._known.pose_at(np.array(state.q)))),
                ('tau_J_d', np.zeros(7) if self.control is None else self.control.torque),
                ('F_T_EE', column_by_column(TOOL)), ('m_ee', mass), ('F_x_Cee', center),
                ('I_ee', inertia.ravel())):
            channel.put(name, numbers)
        channel.mode = MOVES if self.control is not None else 4 if self.error else 1
        channel.success_rate = 1.0

    @functools.cached_property
    def hand_mass(self):
        """Mass, centre and inertia about it of the hand, in the frame of the flange."""
        model, data = self._model, self._data
        data.qpos[:] = FIRST
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        flange = data.site('flange')
        axes, bodies = flange.xmat.reshape(3, 3), []
        for body in range(model.nbody):
            at = body
            while at > 0 and model.body(at).name != 'hand':
                at = model.body_parentid[at]
            if at > 0:
                bodies.append(body)
        masses = model.body_mass[bodies]
        places = (data.xipos[bodies] - flange.xpos) @ axes
        center, total = masses @ places / masses.sum(), np.zeros((3, 3))
        for body, mass, place in zip(bodies, masses, places):
            own = axes.T @ data.ximat[body].reshape(3, 3)
            lever = place - center
            total += own @ np.diag(model.body_inertia[body]) @ own.T + mass * (
                lever @ lever * np.eye(3) - np.outer(lever, lever))
        return masses.sum(), center, total


def column_by_column(pose):
    """A pose as libfranka has it."""
    matrix = np.eye(4)
    matrix[:3, 3] = pose[:3]
    mujoco.mju_quat2Mat(turn := np.empty(9), pose[3:])
    matrix[:3, :3] = turn.reshape(3, 3)
    return matrix.T.ravel().tolist()


def libfranka_time(seconds):
    return SimpleNamespace(to_sec=lambda: seconds)


class Robot:
    """A connection to it; see ``pylibfranka.Robot``."""

    def __init__(self, robot):
        self._robot, self._begun = robot, robot._begun

    @property
    def reached(self):
        """Whether the robot answers."""
        robot = self._robot
        return robot.alive and robot.reachable and robot._begun == self._begun

    def check(self):
        robot = self._robot
        if not robot.reachable:
            robot.clock.sleep_until(robot.clock.now() + PATIENCE_NS)
        if not self.reached:
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


class LockstepChannel(Channel):
    """A channel whose other end is in the same thread."""

    def __init__(self, connection):
        super().__init__()
        self._connection, self._robot = connection, connection._robot

    def receive(self, patience_s):
        robot, integers = self._robot, self.wire.integers
        clock = robot.clock
        clock.sleep_until((clock.now() // CYCLE_NS + 1) * CYCLE_NS)
        if not self._connection.reached:
            clock.sleep_until(clock.now() + round(patience_s * NS))
            return False
        if robot.control is not None:
            robot.control.count_lost()
        robot.report(self)
        integers[BEFORE], integers[ARRIVED_BEFORE] = integers[NUMBER], integers[ARRIVED]
        integers[NUMBER] = (clock.now() - robot._begun) // CYCLE_NS + 1
        integers[ARRIVED] = clock.now()
        return True

    def send(self, torque):
        self.wire.torque[:] = torque
        if self._connection.reached and self._robot.control is not None:
            self._robot.control.answer(torque)


class Control:
    """See ``pylibfranka.ActiveControlBase``."""

    def __init__(self, connection, robot):
        self._connection, self._robot, self.torque = connection, robot, np.zeros(7)
        self._read = 0
        self._commanded = robot.clock.now()

    def _check(self):
        self._connection.check()
        self.count_lost()
        robot = self._robot
        if robot.control is not self:
            raise libfranka.ControlException(
                f'libfranka: Move command aborted: motion aborted by reflex! ["{robot.error}"]')

    def count_lost(self):
        """End the motion if too many commands have not arrived."""
        robot = self._robot
        lost = (robot.clock.now() - self._commanded) // CYCLE_NS
        if robot.control is self and lost > LOST_CYCLES:
            robot.abort('communication_constraints_violation')

    def readOnce(self):  # noqa: N802
        clock = self._robot.clock
        clock.sleep_until((clock.now() // CYCLE_NS + 1) * CYCLE_NS)
        self._check()
        elapsed = (clock.now() - self._read) / NS if self._read else 0.0
        self._read = clock.now()
        return self._robot.state(), libfranka_time(elapsed)

    def writeOnce(self, command):  # noqa: N802
        self._check()
        self.answer(np.array(command.tau_J))
        if command.motion_finished:
            self._robot.control = None

    def answer(self, torque):
        """A command has arrived."""
        robot = self._robot
        if np.abs(torque - self.torque).max() > TORQUE_STEP + 1e-9:
            robot.abort('controller_torque_discontinuity')
            return
        if not np.isfinite(torque).all() or (np.abs(torque) > TORQUE).any():
            robot.abort('tau_j_range_violation')
            return
        # What a client leaves out acts as before.
        for _ in range(max((robot.clock.now() - self._commanded) // CYCLE_NS, 1)):
            robot.move(torque)
        self.torque, self._commanded = torque.copy(), robot.clock.now()


class Hand:
    """A connection to the hand; see ``pylibfranka.Gripper``."""

    def __init__(self, robot):
        self._robot, self._begun, self._grasped = robot, robot._begun, False

    def check(self):
        robot = self._robot
        if not (robot.alive and robot.reachable and robot._begun == self._begun):
            raise libfranka.NetworkException('libfranka gripper: Connection refused')

    def homing(self):
        self._close_to(WIDEST, 0.1)
        return True

    def read_once(self):
        self.check()
        return SimpleNamespace(width=self._robot.width, max_width=WIDEST,
                               is_grasped=self._grasped)

    def move(self, width, speed):
        self._grasped = False
        return self._close_to(width, speed) == width

    def grasp(self, width, speed, force, inner, outer):
        reached = self._close_to(width, speed)
        self._grasped = (self._robot.object_width > 0.0
                         and width - inner <= reached <= width + outer)
        return self._grasped

    def _close_to(self, width, speed):
        """Move the fingers, which takes its time; width that they reach."""
        self.check()
        robot = self._robot
        reached = max(width, robot.object_width) if width < robot.width else width
        takes = abs(reached - robot.width) / speed
        robot.clock.sleep_until(robot.clock.now() + round(takes * NS))
        self.check()
        robot.width = reached
        return reached

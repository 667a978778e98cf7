"""The gripper of a simulated arm: two fingers that hold by friction."""
from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import mujoco
import numpy as np

from gdmp_ros.control.gripper import check_command, GripperCommand, GripperState, HELD_M
from gdmp_ros.errors import DataError
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.sim.arm import Arm

FINGERS = ('left_finger', 'right_finger')
#: Travel of a finger [m], and the largest force of the gripper [N], as those of a Franka hand.
TRAVEL, STRONGEST = 0.04, 70.0
#: Force with which a finger moves without a force in the command [N].
MOVING_FORCE = 30.0
#: Inertia of the drive seen by a finger [kg], stiffness and damping of its control.
ARMATURE, STIFFNESS, DAMPING = 0.1, 2000.0, 25.0
#: The fingers have arrived if they are this near, or rest for this time [m, m/s, s].
NEAR_M, STILL, STILL_S = 5e-4, 1e-3, 0.1
#: Contact of what is held: time constant [s] and damping ratio.
CONTACT = (0.004, 1.0)
#: Friction of the pads: sliding, torsional, rolling.
FRICTION = (1.5, 0.05, 1e-3)


def add_gripper(spec: mujoco.MjSpec) -> None:
    """
    Let the fingers of the built-in hand move.

    :raises DataError: if the model has no such hand
    """
    for name, side in zip(FINGERS, (1.0, -1.0)):
        finger = spec.body(name)
        if finger is None:
            raise DataError(f'the model has no body {name!r}: only the built-in arms have a '
                            'gripper')
        finger.pos = [0.0, 0.0, finger.pos[2]]
        finger.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, side, 0.0],
                         range=[0.0, TRAVEL], armature=ARMATURE, damping=1.0,
                         solref_limit=[0.004, 1.0])
        for geom in finger.geoms:
            # The pads touch each other when the fingers are closed.
            geom.pos[1] = side * geom.size[1]
            geom.friction, geom.condim, geom.solref = FRICTION, 4, CONTACT
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited, motor.ctrlrange = True, [-STRONGEST, STRONGEST]
    left, right = FINGERS
    spec.add_exclude(bodyname1=left, bodyname2=right)
    both = spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1=left, name2=right,
                             objtype=mujoco.mjtObj.mjOBJ_JOINT)
    both.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]
    # What is held does not slip: stiffer friction than by default.
    spec.option.impratio, spec.option.cone = 10.0, mujoco.mjtCone.mjCONE_ELLIPTIC


#: The numbers of a gripper; flags are 0 or 1.
NUMBERS = np.dtype([(name, np.float64) for name in (
    'width', 'force', 'speed',  # of the command (`GripperCommand`)
    'goal',                     # where each finger is to be now [m]
    'still',                    # time for which the fingers have rested [s]
    'moving')])                 # flag: the command is being carried out


class GripperView(NamedTuple):
    """
    A gripper, for kernels.

    :ivar numbers: `NUMBERS`
    :ivar places: of the fingers among positions, velocities and controls, shape (3, 2)
    """

    numbers: np.ndarray
    places: np.ndarray


#: An arm without a gripper.
NO_GRIPPER = GripperView(np.zeros(0), np.zeros((3, 2), dtype=np.int64))


@kernel
def advance_gripper(gripper, position, velocity, control, dt):
    """
    Set the forces of the fingers for the next tick.

    :param gripper: `NO_GRIPPER`: nothing is done
    :param position: of the simulation, as ``velocity`` and ``control``
    """
    if gripper.numbers.size == 0:
        return
    n, places = records_at(gripper.numbers, 0, 1, NUMBERS)[0], gripper.places
    q = 0.5 * (position[places[0, 0]] + position[places[0, 1]])
    v = 0.5 * (velocity[places[1, 0]] + velocity[places[1, 1]])
    end, step = 0.5 * n.width, 0.5 * n.speed * dt
    # With a force it presses on beyond the width; otherwise it stops there.
    beyond = TRAVEL if n.force > 0.0 else 0.0
    n.goal += min(max(end - beyond - n.goal, -step), step)
    most = n.force if n.force > 0.0 else MOVING_FORCE
    force = min(max(STIFFNESS * (n.goal - q) - DAMPING * v, -most), most)
    for k in range(2):
        control[places[2, k]] = force
    n.still = n.still + dt if abs(v) < STILL else 0.0
    arrived = abs(q - end) < NEAR_M and beyond == 0.0
    # Pressing needs some time until the force is there.
    pressed = abs(force) >= 0.99 * most and n.still > STILL_S
    if arrived or pressed or n.still > 1.0:
        n.moving = 0.0


class SimulatedGripper:
    """
    Moves the fingers; the loop of the simulation calls `advance` in every tick.

    A command with a force closes until each finger presses with that force.

    :ivar view: for kernels
    :ivar called: called when there is a command for the next tick
    """

    widest = 2.0 * TRAVEL

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, prefix: str = ''):
        """
        Find the fingers.

        :param prefix: of their names in a world of several arms (`gdmp_ros.sim.two_arms`)
        :raises DataError: if the model has no moving fingers (`add_gripper`)
        """
        self._data = data
        try:
            joints = [model.joint(prefix + name) for name in FINGERS]
        except KeyError:
            raise DataError('the model has no gripper') from None
        self.view = GripperView(np.zeros(len(NUMBERS.names or ())), np.array([
            [joint.qposadr[0] for joint in joints], [joint.dofadr[0] for joint in joints],
            [model.actuator(prefix + name).id for name in FINGERS]]))
        self._numbers = records_at(self.view.numbers, 0, 1, NUMBERS)[0]
        self._commands = 0
        self._next: GripperCommand | None = None
        self.called: Callable[[], object] = lambda: None
        self.reset()

    @property
    def state(self) -> GripperState:
        """The newest state."""
        commands, numbers, width = self._commands, self._numbers, self._width
        moving = bool(numbers.moving)
        holding = bool(numbers.force and not moving and width > numbers.width + HELD_M)
        problem = ''
        if commands and not moving and not numbers.force and (
                abs(width - numbers.width) > 4.0 * NEAR_M):
            problem = f'the fingers stopped at {width:.4f} m, expected {numbers.width:.4f} m'
        return GripperState(width, self.widest, moving, holding, commands, problem)

    @property
    def _width(self) -> float:
        return float(2.0 * self._data.qpos[self.view.places[0]].mean())

    def reset(self) -> None:
        """Open, at rest."""
        self._data.qpos[self.view.places[0]] = TRAVEL
        self._next = None
        self._begin(GripperCommand(self.widest))
        self._numbers.moving = 0.0

    def _begin(self, command: GripperCommand) -> None:
        numbers = self._numbers
        numbers.moving, numbers.still, numbers.goal = 1.0, 0.0, 0.5 * self._width
        numbers.width, numbers.force, numbers.speed = command

    def command(self, command: GripperCommand) -> int:
        """Begin a command with the next tick; see `gdmp_ros.control.gripper.Gripper`."""
        check_command(command, self.widest, STRONGEST)
        self._next = command
        self.called()
        return self._commands + 1

    @property
    def only_goes_on(self) -> bool:
        """Whether there is no command for the next tick."""
        return self._next is None

    def begin_next(self) -> None:
        """Begin the command that was given, if there is one."""
        given, self._next = self._next, None
        if given is not None:
            self._begin(given)
            self._commands += 1

    def advance(self, dt: float) -> None:
        """Set the forces of the fingers for the next tick."""
        self.begin_next()
        data = self._data
        advance_gripper(self.view, data.qpos, data.qvel, data.ctrl, dt)


class GripperOfLoop:
    """A simulated gripper, as a player sees it."""

    def __init__(self, gripper: SimulatedGripper):
        self._gripper = gripper

    def send(self, command: GripperCommand) -> None:
        """Begin a command with the next tick."""
        self._gripper.command(command)

    def state(self) -> GripperState:
        """The newest state."""
        return self._gripper.state


def arm_with_gripper(model: str = '') -> tuple[Arm, SimulatedGripper | None]:
    """
    Return an arm whose fingers move, and its gripper; None for a model without the built-in hand.

    :param model: as for `gdmp_ros.sim.arm.Arm`
    :raises DataError: if the model cannot be loaded
    """
    try:
        arm = Arm(model, extras=[add_gripper])
    except DataError:
        return Arm(model), None
    return arm, SimulatedGripper(arm.model, arm.data)

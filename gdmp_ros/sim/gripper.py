"""The gripper of a simulated arm: two fingers that hold by friction."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.control.gripper import check_command, GripperCommand, GripperState, HELD_M
from gdmp_ros.errors import DataError

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


class SimulatedGripper:
    """
    Moves the fingers; the loop of the simulation calls `advance` in every tick.

    A command with a force closes until each finger presses with that force.
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
        self._q = np.array([joint.qposadr[0] for joint in joints])
        self._v = np.array([joint.dofadr[0] for joint in joints])
        self._u = np.array([model.actuator(prefix + name).id for name in FINGERS])
        self._wanted = GripperCommand(self.widest)
        self._commands, self._still = 0, 0.0
        self._next: GripperCommand | None = None
        self.reset()

    @property
    def state(self) -> GripperState:
        """The newest state."""
        return self._state

    def reset(self) -> None:
        """Open, at rest."""
        self._data.qpos[self._q] = TRAVEL
        self._next = None
        self._wanted, self._goal = GripperCommand(self.widest), TRAVEL
        self._moving = False
        self._state = self._now()

    def command(self, command: GripperCommand) -> int:
        """Begin a command with the next tick; see `gdmp_ros.control.gripper.Gripper`."""
        check_command(command, self.widest, STRONGEST)
        self._next = command
        return self._commands + 1

    def advance(self, dt: float) -> None:
        """Set the forces of the fingers for the next tick."""
        q, v = float(self._data.qpos[self._q].mean()), float(self._data.qvel[self._v].mean())
        given, self._next = self._next, None
        if given is not None:
            self._wanted, self._goal, self._still = given, q, 0.0
            self._moving, self._commands = True, self._commands + 1
        target = self._wanted
        end = 0.5 * target.width
        step = 0.5 * target.speed * dt
        # With a force it presses on beyond the width; otherwise it stops there.
        beyond = TRAVEL if target.force else 0.0
        self._goal += float(np.clip(end - beyond - self._goal, -step, step))
        most = target.force or MOVING_FORCE
        force = float(np.clip(STIFFNESS * (self._goal - q) - DAMPING * v, -most, most))
        self._data.ctrl[self._u] = force
        self._still = self._still + dt if abs(v) < STILL else 0.0
        arrived = abs(q - end) < NEAR_M and not beyond
        # Pressing needs some time until the force is there.
        pressed = abs(force) >= 0.99 * most and self._still > STILL_S
        if self._moving and (arrived or pressed or self._still > 1.0):
            self._moving = False
        self._state = self._now()

    def _now(self) -> GripperState:
        width = float(2.0 * self._data.qpos[self._q].mean())
        target = self._wanted
        holding = bool(target.force and not self._moving and width > target.width + HELD_M)
        problem = ''
        if self._commands and not self._moving and not target.force and (
                abs(width - target.width) > 4.0 * NEAR_M):
            problem = f'the fingers stopped at {width:.4f} m, expected {target.width:.4f} m'
        return GripperState(width, self.widest, self._moving, holding, self._commands, problem)

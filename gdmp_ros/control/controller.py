"""Impedance controller: reference guard, and the compiled tick of the law."""
from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gdmp_ros.control import contact, memory
from gdmp_ros.control.arm_states import ArmStates, Request
from gdmp_ros.control.friction import friction_of
from gdmp_ros.control.guard import ReferenceGuard
from gdmp_ros.control.impedance import external_wrench
from gdmp_ros.control.joint_path import CALLED, JointPath, make_way, WAITS
from gdmp_ros.control.joint_spring import joint_springs
from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.law import compute, finish, hold_tool, let_move, NOT_FINITE
from gdmp_ros.control.limit_rows import row_name
from gdmp_ros.control.limits import LimitCounters
from gdmp_ros.control.measurement import JointLimits, Measurement, Tick
from gdmp_ros.control.memory import JOINT_MOTION, JOINT_SPRINGS, TOOL_SPRING
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.control.own_body import (
    Body,
    carried_capsules,
    clearances,
    KEEP,
    LOAD,
    NO_BODY,
    placed,
)
from gdmp_ros.control.posture import Posture
from gdmp_ros.control.reference_kinds import MeasuredMotion
from gdmp_ros.control.settings import ControllerSettings
from gdmp_ros.control.spring import moved_with_tool, spring_wrench, stored_energy
from gdmp_ros.control.stiffness import diagonal_bounds
from gdmp_ros.control.stream import free_damping
from gdmp_ros.control.surroundings import depths, NEARER_M, SLACK
from gdmp_ros.control.tank import EnergyTank
from gdmp_ros.control.target import POSE, STIFFNESS, WRENCH
from gdmp_ros.control.torque_limits import outside_of, relief_of, SPEED_MARGIN
from gdmp_ros.control.weight import GRAVITY, moments_of
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.manifolds.linalg import is_finite
from gdmp_ros.scene.scene import Scene
from gdmp_ros.util.settings import numbers

#: A hand may guide an arm whose motors hold no more than this at the tool beyond the model [N].
UNEXPLAINED_N = 3.0
#: Friction of a guided arm beside the force that is unexplained.
FRICTION_SHARE = 1.5
#: Joints are checked at this distance on their way [rad].
WAY_STEP = 0.02
#: A reference is blocked that has made no way for this time [s].
BLOCKED_S = 0.5
_NOTHING = np.zeros(36)
_NOTHING.setflags(write=False)


class ImpedanceController:
    """
    Impedance control of an arm that follows references; without ROS and simulator.

    :ivar numbers: memory of the compiled tick
    :ivar memory: its parts
    :ivar guard: decides which references are followed
    :ivar tank: energy that may be added
    :ivar counters: of the limits
    :ivar posture: of the null space
    :ivar scene: what is around the arm, in the frame of its base
    """

    guard: ReferenceGuard

    def __init__(self, joints: JointLimits, friction: np.ndarray, chain: Chain,
                 settings: ControllerSettings | None = None, states: ArmStates | None = None,
                 body: Body = NO_BODY):
        """
        Prepare to control.

        :param friction: viscous friction of the model's joints [Nm s/rad], shape (n,)
        :param chain: the joints between base and tool
        :param states: of the arm
        :param body: shape of the arm
        :raises ParameterError: if the settings do not fit the joints
        """
        settings = settings or ControllerSettings()
        self.states = states or ArmStates()
        self._joints, self._model_friction, self._chain = joints, friction, chain
        body = body.with_load()
        self._next: ControllerSettings | None = None
        self._next_scene: Scene | None = None
        self.scene = Scene()
        self._refills = False
        self.numbers = memory.blank(len(joints.torque), len(body.capsules), len(body.pairs))
        self.memory = memory.parts(self.numbers)
        self.posture = Posture(joints, self.memory)
        self.memory.scalars.cycle = joints.cycle
        self.memory.frames[:], self.memory.axes[:] = chain
        self.memory.capsules[:], self.memory.pairs[:] = body.capsules, body.pairs
        self.memory.scalars.permitted = self.memory.scalars.allowed = 1.0
        self._body, self._held = body._replace(capsules=self.memory.capsules), ''
        self.counters = LimitCounters(self.memory.counts, self.memory.recent)
        self.tank = EnergyTank(self.memory, settings.tank)
        self.check(settings)
        self._use(settings)

    def configure(self, settings: ControllerSettings) -> None:
        """
        Use other settings from the next tick on; torque, stiffness and energy carry over.

        :raises ParameterError: if they do not fit the joints
        """
        self.check(settings)
        self._next = settings

    def check(self, settings: ControllerSettings) -> None:
        """:raises ParameterError: if the settings do not fit the joints"""
        dry = friction_of(settings.friction, self._model_friction)[0][1]
        if (dry > self._joints.torque).any():
            at = int(np.argmax(dry - self._joints.torque))
            raise ParameterError(f'friction, dry: {dry[at]:g} Nm at joint {at + 1}, expected at '
                                 f'most {self._joints.torque[at]:g}, what its motor can do')
        self.posture.check(settings.posture)
        moments_of(settings.weight_moments, len(self._joints.torque))

    def surround(self, scene: Scene) -> None:
        """
        Keep away from the volumes of a scene from the next tick on.

        What is nearer than its margin already does not push: only what the arm does counts.

        :param scene: in the frame of the base
        :raises DataError: if it does not fit the arm
        """
        scene = scene.copy()
        scene.packed(self._body.bits)
        if len(scene.carried) > LOAD:
            raise DataError(f'what the arm carries takes {len(scene.carried)} capsules, expected '
                            f'at most {LOAD}')
        self._next_scene = scene

    def hold_back(self, reason: str) -> None:
        """
        Let references make no way, as long as there is a reason; they go on when it is empty.

        :param reason: why
        """
        self._held = reason
        self.memory.scalars.permitted = 0.0 if reason else 1.0

    def capsules(self, age: float) -> np.ndarray:
        """
        Where the arm is, and where it was; see `gdmp_ros.control.own_body.placed`.

        :param age: how long ago [s]
        """
        arm = self.memory
        now, before = arm.position.copy(), arm.position - age * arm.velocity
        return np.vstack([placed(self._chain, self._body, position) for position in
                          (now, 0.5 * (now + before), before)])

    def body(self, step: float) -> list[np.ndarray]:
        """
        Capsules of the arm, and of what it carries, now and after a step [s].

        See `gdmp_ros.control.own_body.placed`; what is not carried has the radius 0.
        """
        now = self.memory.position.copy()
        # Another thread may change what is carried.
        body = self._body._replace(capsules=self._body.capsules.copy())
        return [placed(self._chain, body, position)
                for position in (now, now + step * self.memory.velocity)]

    @property
    def links(self) -> tuple[str, ...]:
        """Link of each capsule."""
        return self._body.links

    def check_way(self, postures: np.ndarray) -> None:
        """
        Check straight ways of joint space from where the arm is; what is near already may stay so.

        :param postures: one after another [rad], shape (T, n)
        :raises ParameterError: if a link would come nearer to a volume than its margin
        """
        if self._held:
            raise ParameterError(self._held)
        scene, places = self._next_scene or self.scene, [self.memory.position.copy(), *postures]
        volumes = scene.packed(self._body.bits)
        if not len(volumes):
            return
        known = np.maximum(depths(self._chain, self._body, places[0], volumes), 0.0) + NEARER_M
        for number, (begin, end) in enumerate(zip(places, places[1:])):
            for share in np.linspace(0.0, 1.0, 2 + int(np.abs(end - begin).max() / WAY_STEP)):
                deep = depths(self._chain, self._body, begin + share * (end - begin), volumes)
                at = np.unravel_index(int(np.argmax(deep - known)), deep.shape)
                if deep[at] > known[at]:
                    raise ParameterError(
                        f'blocked by {scene.names[at[0]]}: {self._body.links[at[1]]} would be '
                        f'{1e3 * deep[at]:.0f} mm inside its margin after '
                        f'{100.0 * (number + share) / (len(places) - 1):.0f} % of the way')

    def take_posture(self) -> None:
        """Approach the posture of the settings again, if there is one."""
        self.posture.use(self.settings.posture)

    def refill_tank(self) -> None:
        """Fill the energy tank as at the start, with the next tick."""
        self._refills = True

    def reset(self, measured: Measurement, end: np.ndarray) -> None:
        """
        Hold the measured pose, with the tank as at the start.

        :param end: where the tool is in the frame of the last joint
        """
        arm, settings = self.memory, self.settings
        self._put_end(end)
        self.posture.hold(measured.position)
        self.posture.use(settings.posture)
        arm.last[:] = np.clip(measured.bias, -arm.largest, arm.largest)
        if not hasattr(self, 'guard'):
            self.guard = ReferenceGuard(settings.guard, measured.pose, settings.damping_ratio,
                                        len(measured.position), self.states, settings.limits)
        self.guard.restart(MeasuredMotion(
            measured.pose.copy(), np.zeros(6), measured.position.copy(),
            np.zeros_like(measured.velocity)))
        self.tank.settings = settings.tank
        self.tank.reset()
        self._last_pose, self._last_position = measured.pose.copy(), measured.position.copy()
        arm.felt[:] = arm.correction[:] = arm.relief[:] = 0.0
        arm.moments[:] = arm.wanted_moments
        arm.scalars.unknown, arm.scalars.slowed, arm.scalars.left = 0.0, 1.0, 1.0
        arm.nearness[:] = np.maximum(KEEP - clearances(self._chain, self._body, measured.position),
                                     0.0)
        count = len(self.scene)
        arm.depth[:count] = np.maximum(self._depths(measured.position, arm.volumes[:count]), 0.0)
        self._hold(measured.pose, measured.position)

    def tick(self, measured: Measurement, dt: float) -> Tick:
        """Compute the torque for the next ``dt`` seconds."""
        damping = free_damping(self.guard.numbers)
        if damping > 0.0:
            return self._without_reference(measured, dt, lambda: let_move(self.numbers, damping))
        self._take_settings()
        (arm, twist), guard = self._measured(measured, dt), self.guard
        known = is_finite(measured.pose) and is_finite(twist)
        robot = MeasuredMotion(measured.pose, twist, measured.position, measured.velocity)
        target = guard.target(dt, robot if known else None)
        if guard.in_joints:
            does, arm.joint_target[:] = JOINT_SPRINGS, target
        else:
            does, arm.target[:] = TOOL_SPRING, target
        arm.scalars.does = does
        self._answer(compute(self.numbers), measured)
        if known:
            self._last_pose, self._last_position = measured.pose.copy(), measured.position.copy()
        return self._tick(measured, twist)

    @property
    def only_goes_on(self) -> bool:
        """Whether no setting changes: then a kernel can make the next tick."""
        return not (self._next is not None or self._next_scene is not None or self._refills)

    def catch_up(self) -> None:
        """Know where the robot is, after ticks that a kernel has made."""
        arm = self.memory
        self._last_pose, self._last_position = arm.pose.copy(), arm.position.copy()
        self.guard.measure(0.0, MeasuredMotion(self._last_pose, arm.twist.copy(),
                                               self._last_position, arm.velocity.copy()))

    def end_tick(self, event: int) -> Tick:
        """End a tick of a kernel in which something was felt, or no torque could be computed."""
        arm = self.memory
        measured = Measurement(
            arm.position.copy(), arm.velocity.copy(), arm.pose.copy(), arm.jacobian.copy(),
            arm.inertia.copy(), arm.bias.copy(), arm.external.copy(), arm.acceleration.copy(),
            arm.scalars.potential)
        self.catch_up()
        mode, springs = self.states.state.mode, arm.scalars.does in (TOOL_SPRING, JOINT_SPRINGS)
        self._answer(event, measured)
        return self._tick(measured, arm.twist.copy(), None if springs else mode)

    def _answer(self, event: int, measured: Measurement) -> None:
        """Do what an event of the law asks for."""
        if event == NOT_FINITE:
            self._recover(measured)
            finish(self.numbers, True)
        elif event and event != CALLED:
            self._react(event)

    def move_joints(self, measured: Measurement, path: JointPath, dt: float) -> Tick:
        """
        Compute the torque for the next ``dt`` seconds of an arm that makes a motion of the joints.

        For slow motions; all limits and the reaction to collisions stay in force. From the next
        `tick` on the arm is held where it is.
        """
        return self._without_reference(measured, dt, lambda: make_way(self.numbers, path, dt))

    def move_tool(self, before: np.ndarray, after: np.ndarray, end: np.ndarray) -> None:
        """
        Go on holding with the same wrench, after another point became the tool.

        With too little energy for it the new tool is held where it is.

        :param before: pose of the last tool (x, y, z, qw, qx, qy, qz)
        :param after: pose of the new one
        :param end: where it is in the frame of the last joint
        """
        arm = self.memory
        pose = arm.reference[POSE:POSE + 7]
        stored = stored_energy(before, arm.reference, arm.gains)
        wanted = moved_with_tool(arm.reference, before, after, arm.gains)
        # What it carries has not moved: `surround` tells where it is in the new tool.
        arm.end[:] = end
        arm.governed[:] = self._chain.near(wanted, arm.governed, end)
        pose[:] = self._chain.pose_at(arm.governed, end)
        if not stored_energy(after, arm.reference, arm.gains) - stored <= self.tank.energy:
            arm.governed[:], pose[:] = arm.position, after
        self.guard.hold(pose.copy())

    def begin_guiding(self) -> str:
        """
        Prepare for a hand that guides the arm.

        A force that the model does not explain would move the arm by itself: it is held by
        friction of this size, up to `UNEXPLAINED_N`.

        :returns: why no hand can guide the arm; empty if one can
        """
        force = self._unexplained_force()
        size = float(np.linalg.norm(force))
        self.memory.scalars.free_friction = FRICTION_SHARE * size
        if size <= UNEXPLAINED_N:
            return ''
        # A weight acts downwards.
        why = (f'the payload is wrong by {force[2] / GRAVITY:+.2g} kg (~/set_payload)'
               if abs(force[2]) > 0.8 * size else 'something pushes the arm, or it still moves')
        return (f'the motors hold {size:.1f} N at the tool that the model does not explain, '
                f'expected at most {UNEXPLAINED_N:g}: {why}, or friction is not known')

    def _unexplained_force(self) -> np.ndarray:
        """Force at the tool with which the law holds the arm at rest [N], shape (3,)."""
        arm, wrench, does = self.memory, np.zeros(6), self.memory.scalars.does
        if does == TOOL_SPRING:
            spring_wrench(arm.pose, arm.reference, arm.gains, wrench)
            return wrench[:3] + arm.reference[WRENCH:WRENCH + 3]
        torque = arm.torque - arm.bias
        # Friction may hold a part of it.
        torque -= np.clip(torque, -arm.friction[1], arm.friction[1])
        if does == JOINT_SPRINGS:
            joint_springs(arm.position, arm.joint_reference, torque)
        external_wrench(arm.jacobian, arm.inertia, torque, self.settings.gains.singularity, wrench)
        return wrench[:3]

    @property
    def blocked(self) -> str:
        """
        What keeps the governed reference from its target, or a motion of the joints from its way.

        Empty if it makes way.
        """
        scalars = self.memory.scalars
        if self._moving and scalars.share < WAITS:
            nearest = self.clearance[1]
            return self._held or (f'what is near: {nearest}' if nearest else 'what is around')
        if scalars.blocked < BLOCKED_S:
            return ''
        if self._held:
            return self._held
        if scalars.blocking < 0.0:
            return 'what holds the tool'
        try:
            return row_name(int(scalars.blocking), len(self._joints.torque), self._body.names,
                            self._body.links, self.scene.names)
        except IndexError:  # of a scene before the present one
            return ''

    @property
    def clearance(self) -> tuple[float, str]:
        """Least distance of the reference from what is around [m], and the names; inf and ''."""
        scalars = self.memory.scalars
        if not len(self.scene) or scalars.nearest < 0.0:
            return np.inf, ''
        volume, link = divmod(int(scalars.nearest), len(self._body.links))
        if volume >= len(self.scene.names):  # of a scene before the present one
            return np.inf, ''
        return float(scalars.clearance), f'{self._body.links[link]} and {self.scene.names[volume]}'

    @property
    def scale(self) -> float:
        """Share of the speed that is left, beside what comes nearer or is not known any more."""
        scalars = self.memory.scalars
        if self._moving:
            return float(scalars.share)
        return float(min(scalars.slowed if len(self.scene) else 1.0, scalars.allowed))

    @property
    def _moving(self) -> bool:
        """Whether a motion of the joints goes on."""
        return bool(self.memory.scalars.does == JOINT_MOTION)

    @property
    def reference(self) -> np.ndarray:
        """The governed reference, of the tool or of the joints."""
        arm = self.memory
        return (arm.reference if arm.scalars.law == TOOL_SPRING else arm.joint_reference).copy()

    def _measured(self, measured: Measurement, dt: float
                  ) -> tuple[memory.ArmMemory, np.ndarray]:
        """Write what was measured into the memory; returns its parts, and the twist."""
        arm = self.memory
        (arm.position[:], arm.velocity[:], arm.pose[:], arm.jacobian[:], arm.inertia[:],
         arm.bias[:], arm.external[:], arm.acceleration[:], arm.scalars.potential) = measured
        twist = measured.jacobian @ measured.velocity
        arm.twist[:], arm.scalars.dt = twist, dt
        return arm, twist

    def _without_reference(self, measured: Measurement, dt: float, compute: Callable[[], int]
                           ) -> Tick:
        """Gravity is compensated, and there is no stiffness."""
        self._take_settings()
        _, twist = self._measured(measured, dt)
        self.guard.measure(dt, MeasuredMotion(measured.pose, twist, measured.position,
                                              measured.velocity))
        self.guard.hold(measured.pose)
        # A collision ends what the arm does after this tick.
        mode = self.states.state.mode
        self._answer(compute(), measured)
        return self._tick(measured, twist, mode)

    def _tick(self, measured: Measurement, twist: np.ndarray, mode: ArmMode | None = None
              ) -> Tick:
        """
        What has been done in a tick.

        :param mode: in which it was; by default in the present one
        """
        arm, scalars = self.memory, self.memory.scalars
        applied, requested = ((target[STIFFNESS:STIFFNESS + 36].copy()
                               for target in (arm.reference, self.guard.targets[0]))
                              if scalars.does == TOOL_SPRING else (_NOTHING, _NOTHING))
        joints = arm.joint_reference.copy() if scalars.does == JOINT_SPRINGS else None
        return Tick(measured, twist, arm.wrench.copy(), applied, requested, arm.torque.copy(),
                    arm.commanded.copy(), self.guard.mode if mode is None else mode,
                    scalars.stored, scalars.energy, arm.violation.copy(), joints)

    def _react(self, event: int) -> None:
        """React to a collision with what the arm does because of a request."""
        if self.states.state.moves:
            comply = self.settings.contact.collision_reaction == 'comply'
            self.states.take(Request.COMPLY if comply else Request.COLLISION,
                             contact.described(event, self.memory.scalars.against))

    def _use(self, settings: ControllerSettings) -> None:
        self.settings = settings
        arm, joints, limits, felt = (self.memory, self._joints, settings.limits, settings.contact)
        arm.friction[:], arm.credit[:] = friction_of(settings.friction, self._model_friction)
        arm.wanted_moments[:] = moments_of(settings.weight_moments, len(arm.position))
        arm.gains[:], arm.limits[:] = numbers(settings.gains), numbers(limits)
        arm.bounds[:] = diagonal_bounds(limits.stiffness_min, limits.stiffness_max)
        arm.largest[:], arm.fastest[:] = (joints.torque,
                                          joints.fastest(limits.joint_speed))
        arm.joint_limits[:3] = joints.lower, joints.upper, SPEED_MARGIN * arm.fastest
        arm.joint_limits[3:] = 0.0 if joints.slowing is None else joints.slowing
        scalars = arm.scalars
        scalars.damping_ratio = settings.damping_ratio
        scalars.collision_force, scalars.collision_torque = (felt.collision_force,
                                                             felt.collision_torque)
        scalars.feedback_force, scalars.feedback_torque = felt.force_feedback_max

    def _take_settings(self) -> None:
        settings, self._next = self._next, None
        scene, self._next_scene = self._next_scene, None
        if scene is not None:
            self._take_scene(scene)
        if self._refills:
            self._refills = False
            self.tank.fill()
        if settings is None:
            return
        if settings.posture != self.settings.posture:
            self.posture.use(settings.posture)
        self.memory.relief[:] = relief_of(self.memory.position, self._joints, self.settings.limits,
                                          settings.limits, self.memory.relief)
        self.memory.outside[:] = outside_of(self.memory.pose[:3], self.settings.limits,
                                            settings.limits, self.memory.outside)
        # The last torque stays: a smaller limit is no step of it.
        self._use(settings)
        self.guard.configure(settings.guard, settings.limits, settings.damping_ratio)
        self.tank.configure(settings.tank)

    def _take_scene(self, scene: Scene) -> None:
        arm, before = self.memory, {name: k for k, name in enumerate(self.scene.names)}
        rows = scene.packed(self._body.bits)
        known = self._depths(arm.position, arm.volumes[:len(before)])
        self.scene = scene
        self._put_end(arm.end)
        deep = self._depths(arm.position, rows)
        acts = np.zeros_like(deep)  # how much of the depth acts at present
        for k, name in enumerate(scene.names):
            if name in before:
                at = before[name]
                acts[k] = np.maximum(known[at] - arm.depth[at], 0.0)
        arm.volumes[:], arm.depth[:] = 0.0, 0.0
        arm.volumes[:len(rows)] = rows
        arm.depth[:len(rows)] = np.maximum(np.maximum(deep, 0.0) - acts, 0.0)
        arm.scalars.seen = 0.0

    def _put_end(self, end: np.ndarray) -> None:
        """Put the tool, and what it carries, where they are in the frame of the last joint."""
        self.memory.end[:] = end
        carried_capsules(self.scene.carried, self.memory.end, len(self.memory.position),
                         self.memory.capsules)

    def _depths(self, position: np.ndarray, volumes: np.ndarray) -> np.ndarray:
        """How deep each link is where the barrier of each volume acts [m]."""
        return depths(self._chain, self._body, position, volumes) + SLACK

    def _hold(self, pose: np.ndarray, position: np.ndarray) -> None:
        """
        Hold the tool where it is, with the stiffness before the first reference.

        :param pose: of the tool there
        :param position: of the joints [rad]
        """
        arm = self.memory
        arm.scalars.law = TOOL_SPRING
        arm.pose[:], arm.position[:] = pose, position
        hold_tool(self.numbers)

    def _recover(self, measured: Measurement) -> None:
        """No torque could be computed: hold the measured pose, and compensate gravity."""
        arm = self.memory
        if is_finite(measured.pose) and is_finite(measured.position):
            self._last_pose, self._last_position = measured.pose, measured.position
        self._hold(self._last_pose, self._last_position)
        self.guard.measure(0.0, MeasuredMotion(self._last_pose, np.zeros(6)))
        self.guard.fault('a measurement or a torque was not finite')
        self.tank.empty()
        arm.scalars.does, arm.scalars.stored = TOOL_SPRING, 0.0
        arm.torque[:] = measured.bias if is_finite(measured.bias) else arm.last

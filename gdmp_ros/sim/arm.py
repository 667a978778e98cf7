"""A torque-controlled arm in MuJoCo: the built-in Panda, or any other MJCF."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import mujoco
import numpy as np

from gdmp_ros.control.kinematics import Chain
from gdmp_ros.control.manipulability import jacobian_derivative, PositionState
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.control.own_body import Body
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.poses import compose
from gdmp_ros.sim.chain import body_of, chain_of
from gdmp_ros.sim.frames import Mount, ToolTransform
from gdmp_ros.sim.known_model import KnownModel
from gdmp_ros.sim.model_sources import BUILT_IN, load, make_torque_controlled
from gdmp_ros.sim.native import (
    address,
    external_torque,
    functions,
    ModelView,
    push,
    step,
    TouchedBody,
    view_of,
)
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plant import act, change, channel_of, disturb, PlantSettings, reset_channel

PANDA = BUILT_IN['panda']
#: Adds something to a model.
Extra: TypeAlias = Callable[[mujoco.MjSpec], None]
#: Speed limit of the joints of a model without one [rad/s].
JOINT_SPEED = 2.175
#: Warnings after which MuJoCo resets its state or ignores the torques.
FATAL = [int(kind) for kind in (
    mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC, mujoco.mjtWarning.mjWARN_BADCTRL)]


class Robot(NamedTuple):
    """
    An arm in a simulation.

    :ivar site: id of its tool site
    :ivar joints: its joints, among positions and among velocities
    :ivar motors: its motors among the controls
    """

    model: mujoco.MjModel
    data: mujoco.MjData
    site: int
    joints: slice
    motors: slice


class Arm:
    """
    One arm; `step` advances it by one period under joint torques.

    Of several arms in one simulation (`gdmp_ros.sim.two_arms`) each has its torque set by `act`.

    :ivar known: the model with which it is controlled
    :ivar view: the simulated robot itself, for kernels
    :ivar channel: between them
    :ivar touched: the body of its tool
    """

    def __init__(self, path: str | Path | mujoco.MjSpec = '', tool: str = 'tcp',
                 hand: bool = True, plant: PlantSettings | None = None,
                 extras: Sequence[Extra] = ()):
        """
        Load a model.

        :param path: MJCF file or name (`gdmp_ros.sim.model_sources.load`), or a model under
            construction; the built-in Panda by default
        :param tool: name of the site that is controlled
        :param hand: False removes the body ``hand`` with the tool from the model
        :param plant: how the simulated robot, `model`, differs from the model with which it is
            controlled
        :param extras: add to the simulated robot what the controller does not know: a gripper
            (`gdmp_ros.sim.gripper`), objects (`gdmp_ros.sim.scenes`)
        :raises DataError: if the file cannot be loaded, or has no such site or no motors
        """
        source: Any = path or PANDA
        known, site = _compiled(source, tool, hand)
        model, place, joints = known, site, slice(known.nv)
        settings, shared = plant or PlantSettings(), plant is None and not extras
        if not shared:
            model, place = _compiled(settings.model or source, tool, hand, extras)
            _check_joints(model, known, settings.model or str(source))
            change(model, place, joints, settings)
        self._alone = True
        self._take(Robot(model, mujoco.MjData(model), place, joints, joints), known, site,
                   settings, shared)
        self.reset()

    @classmethod
    def among_others(cls, robot: Robot, known: mujoco.MjModel, plant: PlantSettings) -> Arm:
        """
        Return one of several arms in a simulation.

        :param known: the model with which it is controlled, in the same base frame, with a site of
            the name ``tcp``
        """
        arm = object.__new__(cls)
        arm._alone = False
        arm._take(robot, known, known.site('tcp').id, plant, False)
        return arm

    def _take(self, robot: Robot, known: mujoco.MjModel, site: int, plant: PlantSettings,
              shared: bool) -> None:
        self.model, self.data, self._site, self._joints, self._motors = robot
        true = self.data
        self._torques = (true.qfrc_smooth, true.qfrc_passive, true.qfrc_bias, true.qfrc_actuator,
                         true.qfrc_constraint)
        body = self._body = int(self.model.site_bodyid[self._site])
        self.view: ModelView = view_of(self.model, true, self._site, body)
        self.touched = TouchedBody(true.site_xpos[self._site], true.xipos[body],
                                   true.xfrc_applied[body])
        self._mount = Mount(self.model, self._site)
        self.known = KnownModel(known, self.data if shared else mujoco.MjData(known), site, shared)
        self._known_chain: tuple[Chain, np.ndarray] | None = None
        self._elsewhere: mujoco.MjData | None = None
        self.names = [known.joint(i).name for i in range(known.njnt)]
        lower, upper = np.where(known.jnt_limited[:, None].astype(bool),
                                known.jnt_range, [-np.inf, np.inf]).T
        self.limits = JointLimits(lower, upper, known.actuator_ctrlrange[:, 1].copy(),
                                  _joint_numbers(known, 'joint_speed', JOINT_SPEED), np.array([
                                      _joint_numbers(known, f'joint_slowing_{name}', 0.0)
                                      for name in ('offset', 'deceleration')]))
        self.friction = known.dof_damping.copy()
        self.channel = channel_of(plant, known.njnt, self.period)

    @property
    def tool_body(self) -> int:
        """Id of the body that carries the tool."""
        return self._body

    @property
    def site(self) -> int:
        """The tool site in the model."""
        return self._site

    @property
    def chain(self) -> Chain:
        """
        The joints between the base and the tool.

        :raises ParameterError: if they are not revolute
        """
        return self._chain[0]

    @property
    def _chain(self) -> tuple[Chain, np.ndarray]:
        """The chain, and where the body of the tool is in the frame of its last joint."""
        if self._known_chain is None:
            self._known_chain = chain_of(self.known.model, self.known.body)
        return self._known_chain

    @property
    def shape(self) -> Body:
        """Capsules around the arm, and which of them must not touch."""
        return body_of(self.known.model, self.known.body, self.home)

    @property
    def end_pose(self) -> np.ndarray:
        """Pose (x, y, z, qw, qx, qy, qz) of the tool in the frame of the last joint."""
        model, site = self.known.model, self.known.site
        place = np.concatenate([model.site_pos[site], model.site_quat[site]])
        return compose(self._chain[1], place)

    @property
    def period(self) -> float:
        """Time step [s]."""
        return float(self.model.opt.timestep)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    @property
    def home(self) -> np.ndarray:
        """Joint positions of the model's first keyframe, or 0 [rad]."""
        known = self.known.model
        return np.array(known.key_qpos[0] if known.nkey else known.qpos0)

    def pose_at(self, position: np.ndarray) -> np.ndarray:
        """Pose of the tool (x, y, z, qw, qx, qy, qz) at joint positions [rad]; nothing moves."""
        known, pose = self.known, np.empty(7)
        if self._elsewhere is None:
            self._elsewhere = mujoco.MjData(known.model)
        self._elsewhere.qpos[:] = position
        mujoco.mj_kinematics(known.model, self._elsewhere)
        pose[:3] = self._elsewhere.site_xpos[known.site]
        mujoco.mju_mat2Quat(pose[3:], self._elsewhere.site_xmat[known.site])
        return pose

    def reset(self, position: np.ndarray | None = None) -> None:
        """
        Put the arm at rest at ``position`` [rad], by default at the model's first keyframe.

        If it is alone, everything else is as at the beginning then.
        """
        if self._alone:
            mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self._joints] = self.home if position is None else position
        self.data.qvel[self._joints] = 0.0
        mujoco.mj_forward(self.model, self.data)
        reset_channel(self.channel, self.data.qfrc_bias[self._joints])

    def show(self, position: np.ndarray, others: np.ndarray) -> None:
        """
        Put everything at rest somewhere, to be looked at.

        :param others: positions of what is not a joint of the arm: fingers, objects
        """
        self.data.qpos[self._joints] = position
        self.data.qpos[len(self.names):] = others
        mujoco.mj_kinematics(self.model, self.data)

    def rest(self) -> None:
        """Take the velocity of the joints away."""
        self.data.qvel[self._joints] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def announce(self, payload: Payload) -> None:
        """
        Tell the controller's model what the arm carries; any thread may call it.

        The model changes within `PAYLOAD_S`, so that the torque has no step.
        """
        self.known.announce(payload)

    def put_tool(self, tool: ToolTransform) -> None:
        """Control another point of the body that carries the tool site, from now on."""
        self.known.put_tool(tool)
        self._mount.put(self.model, tool)
        mujoco.mj_kinematics(self.model, self.data)

    def measure(self) -> Measurement:
        """Read the present state."""
        known, true, joints = self.known, self.data, self._joints
        position, velocity = true.qpos[joints].copy(), true.qvel[joints].copy()
        disturb(self.channel, position, velocity)
        known.look(position, velocity, self.period)
        external = np.empty(len(position))
        external_torque(*self._torques, joints.start or 0, external)
        return known.measurement(position, velocity, external)

    def linear_state(self, axes: int = 3) -> PositionState:
        """
        State for a position task, with the derivative of the Jacobian.

        :param axes: number of axes of the task, from x on
        """
        now = self.measure()
        linear, angular = now.jacobian[:3], now.jacobian[3:]
        derivative = jacobian_derivative(linear, angular)
        return PositionState(now.pose[:axes].copy(), linear[:axes],
                             np.ascontiguousarray(derivative[:, :axes]), now.velocity,
                             now.inertia, now.bias, self.friction, now.jdot_qdot[:axes])

    def act(self, torque: np.ndarray) -> None:
        """
        Set joint torques [Nm]; they act when the simulation advances.

        :raises ValueError: unless there is one for each joint
        """
        control, torque = self.data.ctrl[self._motors], np.asarray(torque, float)
        if torque.shape != control.shape:
            raise ValueError(f'{torque.shape} torques, expected {control.shape}')
        act(self.channel, torque, control)

    def step(self, torque: np.ndarray) -> None:
        """Advance by one period under joint torques [Nm]."""
        self.act(torque)
        self.advance()

    def advance(self) -> None:
        """Advance the simulation by one period."""
        advance(self.model, self.data)

    @property
    def only_goes_on(self) -> bool:
        """Whether it is alone in its simulation, and nothing new is carried."""
        return self._alone and self.known.only_goes_on

    def check(self) -> None:
        """:raises DataError: if the simulation is unstable"""
        check(self.data)

    def push(self, wrench: np.ndarray) -> None:
        """Apply an external wrench at the tool from now on (base frame) [N, Nm]."""
        push(self.touched, np.asarray(wrench, float))

    def site_pose(self, name: str) -> np.ndarray:
        """Pose (x, y, z, qw, qx, qy, qz) of a site in the base frame."""
        site, pose = self.data.site(name), np.zeros(7)
        pose[:3] = site.xpos
        mujoco.mju_mat2Quat(pose[3:], site.xmat)
        return pose


def advance(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """
    Advance a simulation by one period.

    :raises DataError: if it is unstable
    """
    step(functions(), address(model), address(data))
    check(data)


def check(data: mujoco.MjData) -> None:
    """:raises DataError: if a simulation is unstable"""
    if data.warning.number[FATAL].any():
        # MuJoCo has reset everything to its initial state silently.
        data.warning.number[:] = 0
        raise DataError('the simulation is unstable: a position, velocity, acceleration or '
                        'torque was not finite or huge')


def _check_joints(robot: mujoco.MjModel, known: mujoco.MjModel, name: str) -> None:
    """:raises DataError: unless the first joints of a robot are those of its model"""
    if robot.nv < known.nv or robot.nu < known.nu or (robot.jnt_type[:known.njnt]
                                                      != known.jnt_type).any():
        raise DataError(f'{name}: the robot has {robot.nv} joints, its model {known.nv}')


def _compiled(source: Any, tool: str, hand: bool,
              extras: Sequence[Extra] = ()
              ) -> tuple[mujoco.MjModel, int]:
    """
    Model with a torque motor for each joint, and the id of its tool site.

    :param source: see `Arm`
    :param extras: see `Arm`; a model with some has no keyframes
    :raises DataError: as `Arm`
    """
    try:
        spec = source if isinstance(source, mujoco.MjSpec) else load(str(source))
        spec = spec.copy() if extras else spec
        if not hand and spec.body('hand') is not None:
            spec.delete(spec.body('hand'))
        if spec.site(tool) is not None:
            make_torque_controlled(spec, tool)
        for key in list(spec.keys) if extras else ():
            spec.delete(key)  # it has no numbers for what is added
        for add in extras:
            add(spec)
        model = spec.compile()
    except DataError:
        raise
    except (ValueError, OSError, mujoco.FatalError) as error:
        raise DataError(f'{source}: cannot load the model: {error}') from None
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, tool)
    if site < 0:
        names = [model.site(i).name for i in range(model.nsite)]
        raise DataError(f'{source}: no site {tool!r}, the model has {names}')
    if model.nu == 0 or (model.nu != model.nv and not extras):
        raise DataError(f'{source}: {model.nu} motors for {model.nv} degrees of freedom, expected '
                        'one torque motor for each')
    return model, site


def _joint_numbers(model: mujoco.MjModel, name: str, default: float) -> np.ndarray:
    """Limits of the joints in a numeric of the model; MJCF has no place for them."""
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if number < 0:
        return np.full(model.nv, default)
    begin = model.numeric_adr[number]
    result = model.numeric_data[begin:begin + model.numeric_size[number]].copy()
    if result.shape != (model.nv,):
        raise DataError(f'numeric {name} has {result.size} numbers, expected {model.nv}, '
                        'one for each joint')
    return np.asarray(result)

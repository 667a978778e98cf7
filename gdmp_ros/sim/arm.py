"""A torque-controlled arm in MuJoCo: the built-in Panda, or any other MJCF."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from gdmp_ros.control.manipulability import jacobian_derivative, PositionState
from gdmp_ros.control.measurement import JointLimits, Measurement
from gdmp_ros.errors import DataError
from gdmp_ros.sim.model_sources import load, make_torque_controlled

PANDA = Path(__file__).parent / 'models' / 'panda.xml'
#: Warnings after which MuJoCo resets its state or ignores the torques.
_BROKEN = [int(kind) for kind in (
    mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC, mujoco.mjtWarning.mjWARN_BADCTRL)]


class Arm:
    """One arm; `step` advances it by one period under joint torques."""

    def __init__(self, path: str | Path | mujoco.MjSpec = '', tool: str = 'tcp',
                 hand: bool = True):
        """
        Load a model.

        :param path: MJCF file or name (`gdmp_ros.sim.model_sources.load`), or a model under
            construction; the built-in Panda by default
        :param tool: name of the site that is controlled
        :param hand: False removes the body ``hand`` with the tool from the model
        :raises DataError: if the file cannot be loaded, or has no such site or no motors
        """
        source: Any = path or PANDA
        try:
            spec = source if isinstance(source, mujoco.MjSpec) else load(str(source))
            if not hand:
                spec.delete(spec.body('hand'))
            if spec.site(tool) is not None:
                make_torque_controlled(spec, tool)
            self.model = spec.compile()
        except DataError:
            raise
        except (ValueError, OSError, mujoco.FatalError) as error:
            raise DataError(f'{source}: cannot load the model: {error}') from None
        self.data = mujoco.MjData(self.model)
        self._site = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, tool)
        if self._site < 0:
            names = [self.model.site(i).name for i in range(self.model.nsite)]
            raise DataError(f'{source}: no site {tool!r}, the model has {names}')
        if self.model.nu == 0 or self.model.nu != self.model.nv:
            raise DataError(f'{source}: {self.model.nu} motors for {self.model.nv} degrees of '
                            'freedom, expected one torque motor for each')
        n = self.model.nv
        self.names = [self.model.joint(i).name for i in range(self.model.njnt)]
        lower, upper = np.where(self.model.jnt_limited[:, None].astype(bool),
                                self.model.jnt_range, [-np.inf, np.inf]).T
        self.limits = JointLimits(lower, upper, self.model.actuator_ctrlrange[:, 1].copy())
        self.friction = self.model.dof_damping.copy()
        self._linear, self._angular = np.zeros((3, n)), np.zeros((3, n))
        self._rate = np.zeros((2, 3, n))
        self._body = int(self.model.site_bodyid[self._site])
        self._inertia, self._pose = np.zeros((n, n)), np.zeros(7)
        self.reset()

    @property
    def tool_body(self) -> int:
        """Id of the body that carries the tool."""
        return self._body

    @property
    def period(self) -> float:
        """Time step [s]."""
        return float(self.model.opt.timestep)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self.data.time)

    def reset(self, position: np.ndarray | None = None) -> None:
        """Put the arm at rest at ``position`` [rad], by default at the first keyframe."""
        mujoco.mj_resetData(self.model, self.data)
        if position is not None:
            self.data.qpos[:] = position
        elif self.model.nkey:
            mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        mujoco.mj_forward(self.model, self.data)

    def measure(self) -> Measurement:
        """Read the present state; the arrays are valid until the next call."""
        model, data = self.model, self.data
        mujoco.mj_jacSite(model, data, self._linear, self._angular, self._site)
        mujoco.mj_jacDot(model, data, *self._rate, data.site_xpos[self._site], self._body)
        mujoco.mj_fullM(model, data, self._inertia)
        mujoco.mj_energyPos(model, data)
        self._pose[:3] = data.site_xpos[self._site]
        mujoco.mju_mat2Quat(self._pose[3:], data.site_xmat[self._site])
        # Everything that is not passive, bias or motor torque is external.
        external = data.qfrc_smooth - data.qfrc_passive + data.qfrc_bias - data.qfrc_actuator
        return Measurement(data.qpos.copy(), data.qvel.copy(), self._pose,
                           np.vstack([self._linear, self._angular]), self._inertia,
                           data.qfrc_bias.copy(), data.qfrc_constraint + external,
                           (self._rate @ data.qvel).reshape(-1), float(data.energy[0]))

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

    def step(self, torque: np.ndarray) -> None:
        """Advance by one period under joint torques [Nm]."""
        self.data.ctrl[:] = torque
        mujoco.mj_step2(self.model, self.data)
        mujoco.mj_step1(self.model, self.data)
        if self.data.warning.number[_BROKEN].any():
            # MuJoCo has reset the arm to its initial state silently.
            self.data.warning.number[:] = 0
            raise DataError('the simulation is unstable: a position, velocity, acceleration or '
                            'torque was not finite or huge')

    def push(self, wrench: np.ndarray) -> None:
        """Apply an external wrench at the tool from now on (base frame) [N, Nm]."""
        body = self._body
        lever = self.data.site_xpos[self._site] - self.data.xipos[body]
        self.data.xfrc_applied[body, :3] = wrench[:3]
        self.data.xfrc_applied[body, 3:] = wrench[3:] + np.cross(lever, wrench[:3])

    def site_pose(self, name: str) -> np.ndarray:
        """Pose (x, y, z, qw, qx, qy, qz) of a site in the base frame."""
        site, pose = self.data.site(name), np.zeros(7)
        pose[:3] = site.xpos
        mujoco.mju_mat2Quat(pose[3:], site.xmat)
        return pose

"""The model with which an arm is controlled: what the arm carries, and where its tool is."""
from __future__ import annotations

import copy

import mujoco
import numpy as np

from gdmp_ros.control.measurement import Measurement
from gdmp_ros.sim import native
from gdmp_ros.sim.frames import Mount, ToolTransform
from gdmp_ros.sim.payload import Load, Payload

#: Time in which another payload is taken over [s].
PAYLOAD_S = 0.5


class KnownModel:
    """
    A model in the measured state of an arm.

    :ivar model: kinematics and dynamics
    :ivar data: their state; that of the simulated robot itself while `shared`
    :ivar level: to be added to the potential energy, so that a new payload is no step, shape (1,)
        [J]
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, site: int, shared: bool):
        """:param shared: whether model and data are those of the simulated robot"""
        self.model, self.data, self.site, self.shared = model, data, site, shared
        self.body = int(model.site_bodyid[site])
        self.mount = Mount(model, site)
        self.level = np.zeros(1)
        self._tool = ToolTransform()
        self._load: Load | None = None
        self._carried = self._carried_before = Payload().moments()
        self._ramp = 1.0
        self._announced: tuple[Payload, mujoco.MjModel, mujoco.MjData, Load] | None = None
        # For kernels, and the data that it is of.
        self._view: native.ModelView | None = None
        self._viewed: mujoco.MjData | None = None

    @property
    def view(self) -> native.ModelView:
        """Model and data, for kernels."""
        if self._view is None or self.data is not self._viewed:
            self._viewed = self.data
            self._view = native.view_of(self.model, self.data, self.site, self.body)
        return self._view

    @classmethod
    def weightless(cls, model: mujoco.MjModel, site: int, rotor_inertia: float) -> KnownModel:
        """
        Return the model of a robot that holds its weight by itself.

        :param model: changed
        :param rotor_inertia: of each joint [kg m²]
        """
        model.opt.gravity[:], model.dof_armature[:] = 0.0, rotor_inertia
        return cls(model, mujoco.MjData(model), site, False)

    @property
    def only_goes_on(self) -> bool:
        """Whether nothing new is carried."""
        return self._announced is None and self._ramp == 1.0

    def announce(self, payload: Payload) -> None:
        """Carry a payload from now on, within `PAYLOAD_S`; any thread may call it."""
        model, data, load = self.model, self.data, self._load
        if load is None:
            if payload == Payload() and self._announced is None:
                return
            model = copy.deepcopy(model)
            data, load = mujoco.MjData(model), Load(model, self.body, self.mount)
        self._announced = payload, model, data, load

    def put_tool(self, tool: ToolTransform) -> None:
        """Put the tool to another place."""
        self._tool = tool
        self.mount.put(self.model, tool)
        mujoco.mj_kinematics(self.model, self.data)

    def look(self, position: np.ndarray, velocity: np.ndarray, dt: float) -> None:
        """Take over a measured state, and ``dt`` seconds of a payload that is new."""
        if self._announced is not None:
            payload, self.model, self.data, self._load = self._announced
            self._announced, self.shared = None, False
            self.mount.put(self.model, self._tool)
            self._carried_before = self._carried_before + self._ramp * (
                self._carried - self._carried_before)
            self._carried, self._ramp = payload.moments(), 0.0
        if self.shared:
            return
        self._be(position, velocity)
        if self._ramp < 1.0 and self._load is not None:
            mujoco.mj_energyPos(self.model, self.data)
            before = self.data.energy[0]
            self._ramp = min(self._ramp + dt / PAYLOAD_S, 1.0)
            self._load.put(self._carried_before
                           + self._ramp * (self._carried - self._carried_before))
            self._be(position, velocity)
            mujoco.mj_energyPos(self.model, self.data)
            # The potential energy has no step either: it is known up to a constant.
            self.level += before - self.data.energy[0]

    def measurement(self, position: np.ndarray, velocity: np.ndarray, external: np.ndarray
                    ) -> Measurement:
        """
        Everything the controller needs in the state of the last `look`.

        :param external: torque of contacts and external forces [Nm]
        """
        data, n = self.data, len(position)
        pose, jacobian, inertia, bias, acceleration = (
            np.empty(7), np.empty((6, n)), np.empty((n, n)), np.empty(n), np.empty(6))
        native.measure(self.view, velocity, pose, jacobian, inertia, bias, acceleration)
        return Measurement(position, velocity, pose, jacobian, inertia, bias, external,
                           acceleration, float(data.energy[0] + self.level[0]))

    def _be(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.data.qpos[:] = position
        self.data.qvel[:] = velocity
        native.look(self.view)

"""Several arms in one simulation, with what is around them."""
from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.sim.arm import advance, Arm, Extra, PANDA, Robot
from gdmp_ros.sim.plant import change, PlantSettings


class World:
    """
    Pandas with their bases at given poses; `advance` lets time pass for all of them.

    Poses of the tools are those in the world.

    :ivar arms: by their names
    :ivar xml: the model as MJCF
    """

    def __init__(self, bases: Mapping[str, np.ndarray], tools: Sequence[Extra] = (),
                 extras: Sequence[Extra] = (), plant: PlantSettings | None = None):
        """
        Build the simulation.

        :param bases: name of each arm, and the pose of its base (x, y, z, qw, qx, qy, qz)
        :param tools: add to each arm what its controller does not know, such as a gripper
        :param extras: add objects to the world
        :param plant: how the simulated arms differ from the models with which they are controlled
        :raises ParameterError: without arms
        """
        if not bases:
            raise ParameterError('a world needs at least one arm')
        world = _without_arm()
        for name, base in bases.items():
            child = mujoco.MjSpec.from_file(str(PANDA))
            for add in tools:
                add(child)
            world.option.impratio, world.option.cone = child.option.impratio, child.option.cone
            frame = world.worldbody.add_frame(pos=base[:3], quat=base[3:])
            frame.attach_body(child.body('link0'), f'{name}_', '')
        for add in extras:
            add(world)
        self.model = world.compile()
        self.xml = world.to_xml()
        self.data = mujoco.MjData(self.model)
        settings = plant or PlantSettings()
        self.arms = {name: self._arm(name, base, settings) for name, base in bases.items()}
        self.reset()

    def _arm(self, name: str, base: np.ndarray, plant: PlantSettings) -> Arm:
        known = mujoco.MjSpec.from_file(str(PANDA))
        known.body('link0').pos, known.body('link0').quat = base[:3], base[3:]
        model, compiled = self.model, known.compile()
        first = model.joint(f'{name}_joint1')
        count = compiled.nv
        motor = model.actuator(f'{name}_joint1').id
        site = model.site(f'{name}_tcp').id
        joints = slice(int(first.qposadr[0]), int(first.qposadr[0]) + count)
        change(model, site, joints, plant)
        return Arm.among_others(Robot(model, self.data, site, joints, slice(motor, motor + count)),
                                compiled, plant)

    @property
    def period(self) -> float:
        """Time step [s]."""
        return float(self.model.opt.timestep)

    def reset(self) -> None:
        """Put everything where it was at the beginning, the arms at their first keyframe."""
        mujoco.mj_resetData(self.model, self.data)
        for arm in self.arms.values():
            arm.reset()

    def advance(self) -> None:
        """
        Advance by one period.

        :raises DataError: if the simulation is unstable
        """
        advance(self.model, self.data)


def _without_arm() -> mujoco.MjSpec:
    """The world of the built-in Panda: floor, light, camera, options."""
    spec = mujoco.MjSpec.from_file(str(PANDA))
    spec.delete(spec.body('link0'))
    for group in (spec.keys, spec.actuators, spec.sensors):
        for one in list(group):
            spec.delete(one)
    return spec

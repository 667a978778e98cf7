"""Planar arms with torque motors, and a point mass on two slides with force motors."""
from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.model_sources import PERIOD

#: Mass of a link [kg/m], thickness [m], rotor inertia [kg m²] and friction of a joint [Nm s/rad].
_LINE_MASS, _THICKNESS, _ARMATURE, _FRICTION = 2.0, 0.02, 0.01, 0.05
_TORQUE, _FORCE = 100.0, 500.0


def _blank() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.option.timestep = PERIOD
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    return spec


def planar_arm(lengths: Sequence[float]) -> Arm:
    """
    Make an arm with revolute joints about z and its base at the origin, without gravity.

    :param lengths: of its links [m]
    """
    spec = _blank()
    body, at = spec.worldbody, 0.0
    for i, length in enumerate(lengths):
        body = body.add_body(name=f'link{i + 1}', pos=[at, 0.0, 0.0])
        joint = body.add_joint(name=f'joint{i + 1}', type=mujoco.mjtJoint.mjJNT_HINGE,
                               axis=[0.0, 0.0, 1.0], armature=_ARMATURE)
        joint.damping[0] = _FRICTION
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0.0, 0.0, 0.0, length, 0.0, 0.0],
                      size=[_THICKNESS, 0.0, 0.0], mass=_LINE_MASS * length, contype=0,
                      conaffinity=0)
        at = length
        _motor(spec, f'joint{i + 1}', _TORQUE)
    body.add_site(name='tcp', pos=[at, 0.0, 0.0])
    return Arm(spec)


def point_mass(mass: float) -> Arm:
    """
    Make a mass that slides along x and y, moved by forces.

    :param mass: [kg]
    """
    spec = _blank()
    body = spec.worldbody.add_body(name='mass')
    for name, axis in (('x', [1.0, 0.0, 0.0]), ('y', [0.0, 1.0, 0.0])):
        body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        _motor(spec, name, _FORCE)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[_THICKNESS, 0.0, 0.0], mass=mass,
                  contype=0, conaffinity=0)
    body.add_site(name='tcp')
    return Arm(spec)


def _motor(spec: mujoco.MjSpec, joint: str, limit: float) -> None:
    motor = spec.add_actuator(name=joint, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    motor.set_to_motor()
    motor.ctrlrange = np.array([-limit, limit])
    motor.ctrllimited = True

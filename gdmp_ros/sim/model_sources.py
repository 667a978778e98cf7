"""
Models of arms from files, from MuJoCo Menagerie and from robot_descriptions.

Many of these models have position actuators and a gripper. The controller needs one torque motor
for each joint that moves the tool, and a site at the tool: `make_torque_controlled` adds them.
"""
from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.util.optional_imports import extra, optional_import

#: Time step of the control loop [s].
PERIOD = 0.001
#: Models of this package.
BUILT_IN = {name: Path(__file__).parent / 'models' / f'{name}.xml' for name in (
    'panda', 'fr3', 'ur5e', 'xarm7')}


class Tool(NamedTuple):
    """The body that holds the tool, and the position of the tool in its frame [m]."""

    body: str
    position: tuple[float, float, float]


#: Tools of models that have no site ``tcp``, by the folder of their file.
TOOLS = {'franka_emika_panda': Tool('hand', (0.0, 0.0, 0.1034)),
         'franka_fr3': Tool('fr3_link7', (0.0, 0.0, 0.107)),
         'franka_fr3_v2': Tool('fr3v2_link7', (0.0, 0.0, 0.107))}


def load(name: str) -> mujoco.MjSpec:
    """
    Load a model.

    :param name: MJCF file; ``panda``, ``fr3``, ``ur5e`` or ``xarm7``, built in; ``menagerie:NAME``
        or ``menagerie:NAME/ENTRY``, such as ``menagerie:kuka_iiwa_14``;
        ``robot_descriptions:NAME``, such as ``robot_descriptions:panda_mj_description``. The
        latter two are downloaded once
    :raises DataError: if there is no such model, or it cannot be downloaded
    """
    source, colon, rest = name.partition(':')
    fetch = {'menagerie': _menagerie, 'robot_descriptions': _robot_descriptions}.get(source)
    path = Path(fetch(rest)) if colon and fetch else BUILT_IN.get(name, Path(name))
    if not path.is_file():
        raise DataError(f'{name}: there is no such file')
    spec = mujoco.MjSpec.from_file(str(path))
    tool = TOOLS.get(path.parent.name)
    if tool is not None and spec.site('tcp') is None and spec.body(tool.body) is not None:
        spec.body(tool.body).add_site(name='tcp', pos=tool.position)
    return spec


def _menagerie(rest: str) -> str:
    name, _, entry = rest.partition('/')
    module = _module('mujoco_menagerie')
    try:
        robot = module.get(name)
        return str(robot.xml(entry or robot.default_model))
    except (module.MenagerieError, OSError) as error:
        raise DataError(f'menagerie:{rest}: {error}') from None


def _robot_descriptions(rest: str) -> str:
    _module('robot_descriptions')
    try:
        return str(importlib.import_module(f'robot_descriptions.{rest}').MJCF_PATH)
    except ModuleNotFoundError:
        raise DataError(f'robot_descriptions:{rest}: there is no such description') from None
    except AttributeError:
        raise DataError(f'robot_descriptions:{rest}: it is not MJCF; take one whose name ends in '
                        '_mj_description') from None
    except Exception as error:  # any error of git
        raise DataError(f'robot_descriptions:{rest}: cannot be downloaded: {error}') from None


def _module(name: str) -> Any:
    with optional_import(extra('models')):
        return importlib.import_module(name)


def make_torque_controlled(spec: mujoco.MjSpec, tool: str) -> None:
    """
    Give a model one torque motor for each joint that moves the tool, unless it has them.

    Other joints, as of a gripper, are fixed at their initial position; sensors are removed. The
    torque limits are those of the model's actuators or joints. The time step becomes 1 ms, and the
    first keyframe keeps the joints of the arm.

    :param tool: name of a site
    :raises DataError: for a joint that is neither hinge nor slide, or has no torque limit
    """
    if _has_motors_only(spec):
        return
    body, moving = spec.site(tool).parent, []
    while body is not None and body.name != 'world':
        moving += [joint.name for joint in reversed(body.joints)]
        body = body.parent
    moving.reverse()
    limits = {name: _torque_limit(spec, name) for name in moving}
    posture = _first_posture(spec, moving)
    for group in (spec.keys, spec.sensors, spec.actuators, spec.tendons, spec.equalities):
        for element in list(group):
            spec.delete(element)
    for joint in list(spec.joints):
        if joint.name not in moving:
            spec.delete(joint)
    for name, limit in limits.items():
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited, motor.ctrlrange = True, [-limit, limit]
    if posture is not None:
        spec.add_key(name='home', qpos=posture)
    spec.option.timestep = PERIOD
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def _has_motors_only(spec: mujoco.MjSpec) -> bool:
    """Whether each joint has exactly one torque motor with limits, in the order of the joints."""
    driven = [actuator.target for actuator in spec.actuators
              if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and actuator.gear[0] == 1.0
              and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED and actuator.gainprm[0] == 1.0
              and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE
              and actuator.ctrlrange[1] > actuator.ctrlrange[0]]
    return len(driven) == len(spec.actuators) and driven == [joint.name for joint in spec.joints]


def _torque_limit(spec: mujoco.MjSpec, joint: str) -> float:
    if spec.joint(joint).type not in (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE):
        raise DataError(f'joint {joint!r} is neither a hinge nor a slide')
    for actuator in spec.actuators:
        if actuator.target != joint or actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        plain = (actuator.gainprm[0] == 1.0 and actuator.biastype == mujoco.mjtBias.mjBIAS_NONE)
        for limits, valid in ((actuator.forcerange, True), (actuator.ctrlrange, plain)):
            if valid and limits[1] > limits[0]:
                return float(abs(actuator.gear[0]) * np.abs(limits).min())
    limits = spec.joint(joint).actfrcrange
    if limits[1] > limits[0]:
        return float(np.abs(limits).min())
    raise DataError(f'joint {joint!r} has no torque limit: give its actuator a forcerange, or the '
                    'joint an actuatorfrcrange')


def _first_posture(spec: mujoco.MjSpec, moving: list[str]) -> np.ndarray | None:
    """Positions of the joints in the first keyframe; None without one."""
    if not spec.keys:
        return None
    model = spec.copy().compile()
    return np.array([model.key_qpos[0, model.joint(name).qposadr[0]] for name in moving])

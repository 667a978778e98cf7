"""The chain of joints between the base of an arm and its tool, from a MuJoCo model."""
from __future__ import annotations

import mujoco
import numpy as np

from gdmp_ros.control.kinematics import Chain
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds.poses import compose

_STILL = np.array([1.0, 0.0, 0.0, 0.0])


def chain_of(model: mujoco.MjModel, body: int) -> tuple[Chain, np.ndarray]:
    """
    Return the joints between the base and a body, and where the body is in the frame of the last.

    :raises ParameterError: if other joints are between than one revolute joint at a body, or the
        model has joints elsewhere
    """
    end = np.array([0.0, 0.0, 0.0, *_STILL])
    frames: list[np.ndarray] = []
    axes: list[np.ndarray] = []
    at = body
    while at > 0:
        frame = np.concatenate([model.body_pos[at], model.body_quat[at]])
        joint, count = int(model.body_jntadr[at]), int(model.body_jntnum[at])
        if count > 1 or (count == 1 and int(model.jnt_type[joint])
                         != int(mujoco.mjtJoint.mjJNT_HINGE)):
            raise ParameterError(f'body {model.body(at).name!r} of the model has other joints '
                                 'than one revolute joint')
        # The joint turns everything of its body about a point of it.
        place = np.concatenate([model.jnt_pos[joint], _STILL]) if count else None
        if place is not None:
            back = np.concatenate([-model.jnt_pos[joint], _STILL])
            if frames:
                frames[0] = compose(back, frames[0])
            else:
                end = compose(back, end)
            frames.insert(0, compose(frame, place))
            axes.insert(0, model.jnt_axis[joint].copy())
        elif frames:
            frames[0] = compose(frame, frames[0])
        else:
            end = compose(frame, end)
        at = int(model.body_parentid[at])
    if len(frames) != model.nv:
        raise ParameterError(f'{len(frames)} of the {model.nv} joints of the model are between '
                             f'its base and {model.body(body).name!r}, expected all')
    return Chain(np.array(frames), np.array(axes)), end

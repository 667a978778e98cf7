"""A body that an arm carries at its tool."""
from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from gdmp_ros.errors import ParameterError
from gdmp_ros.sim.frames import Mount, ToolTransform
from gdmp_ros.util.settings import setting

#: Largest mass [kg], distance of its centre along each axis [m] and entry of the inertia [kg m²].
HEAVIEST, FARTHEST, LARGEST_INERTIA = 20.0, 1.0, 10.0


@dataclass(frozen=True)
class Payload:
    """Mass, centre and inertia, in the frame of the tool site, wherever the tool is put."""

    mass: float = setting(0.0, 'mass that the arm carries at its tool', 'kg', 0.0, HEAVIEST)
    center: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0), 'its centre of mass in the frame of tool_site', 'm', -FARTHEST, FARTHEST)
    inertia: tuple[float, float, float, float, float, float] = setting(
        (0.0,) * 6, 'its inertia about the centre, xx yy zz xy xz yz, along the axes of tool_site',
        'kg m^2', -LARGEST_INERTIA, LARGEST_INERTIA)

    def __post_init__(self) -> None:
        """:raises ParameterError: if no body has this mass and inertia"""
        if not 0.0 <= self.mass <= HEAVIEST:
            raise ParameterError(f'payload: mass is {float(self.mass):g} kg, expected 0 to '
                                 f'{HEAVIEST:g}')
        for name, numbers, most, unit in (
                ('centre', self.center, FARTHEST, 'm'),
                ('inertia', self.inertia, LARGEST_INERTIA, 'kg m²')):
            if not np.all(np.abs(numbers) <= most):
                raise ParameterError(f'payload: {name} is {[*map(float, numbers)]} {unit}, '
                                     f'expected at most {most:g} each')
        moments = np.linalg.eigvalsh(self.matrix)
        # The sum of two principal moments is at least the third.
        if moments[0] < -1e-9 or moments[2] > moments[0] + moments[1] + 1e-9:
            raise ParameterError(f'payload: inertia has the principal moments '
                                 f'{moments.round(6).tolist()}, which no '
                                 'body has')

    @property
    def matrix(self) -> np.ndarray:
        """Inertia about the centre, 3×3 [kg m²]."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def seen_from(self, site: ToolTransform) -> Payload:
        """The same body in the frame in which the tool site is at a place."""
        if self.mass == 0.0:
            return Payload()
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, np.array(site.rotation, float))
        axes = turn.reshape(3, 3)
        xx, xy, xz, yy, yz, zz = (axes @ self.matrix @ axes.T)[np.triu_indices(3)].tolist()
        x, y, z = (axes @ self.center + site.position).tolist()
        return Payload(self.mass, (x, y, z), (xx, yy, zz, xy, xz, yz))

    def moments(self) -> np.ndarray:
        """Mass, mass times centre, inertia about the tool: 10 numbers that add up and blend."""
        return moments_of(self.mass, np.array(self.center), self.matrix)


def moments_of(mass: float, center: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """
    See `Payload.moments`; whether a body has these is not checked.

    :param inertia: about the centre, 3×3 [kg m²]
    """
    about = inertia + mass * _spread(center)
    return np.concatenate([[mass], mass * center, about[np.triu_indices(3)]])


class Load:
    """Puts bodies at the tool of a model."""

    def __init__(self, model: mujoco.MjModel, body: int, mount: Mount):
        """:param body: that carries the tool site"""
        self._model, self._body, self._data = model, body, mujoco.MjData(model)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.body_iquat[body])
        axes = turn.reshape(3, 3)
        self._mass, self._center = float(model.body_mass[body]), model.body_ipos[body].copy()
        self._inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
        self._mount = mount

    def put(self, moments: np.ndarray) -> None:
        """
        Let the model carry a body.

        :param moments: from `Payload.moments`
        """
        model, body, mass = self._model, self._body, moments[0]
        about = np.zeros((3, 3))
        about[np.triu_indices(3)] = moments[4:]
        about += np.triu(about, 1).T
        c = moments[1:4] / mass if mass > 0.0 else np.zeros(3)
        axes = self._mount.axes
        own = axes @ (about - mass * _spread(c)) @ axes.T
        place = self._mount.position + axes @ c
        total = self._mass + mass
        # A body may have no mass.
        share = mass / total if total > 0.0 else 0.0
        center = (1.0 - share) * self._center + share * place
        inertia = (self._inertia + self._mass * _spread(self._center - center)
                   + own + mass * _spread(place - center))
        values, own = np.linalg.eigh(inertia)
        own[:, 2] *= np.sign(np.linalg.det(own))
        mujoco.mju_mat2Quat(model.body_iquat[body], own.reshape(-1))
        model.body_inertia[body], model.body_ipos[body] = values, center
        model.body_mass[body] = total
        mujoco.mj_setConst(model, self._data)


def _spread(offset: np.ndarray) -> np.ndarray:
    """Inertia of a unit mass at a distance."""
    return np.asarray(offset @ offset * np.eye(3) - np.outer(offset, offset))

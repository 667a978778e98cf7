"""
Volumetric obstacle avoidance by potentials: Ginesi et al., J. Intell. Robot. Syst. 101:79, 2021.

A superquadric encloses each volume and the ball around the tool; its potential, static or
dependent on the velocity, accelerates a classical movement primitive.
"""
from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import Rotation

from gdmp_ros.scene.volume import Volume

#: Where a potential is not defined, inside of a superquadric, it is taken at this value.
_LEAST = 1e-2
#: Exponent 2 n of boxes: rounder ones enclose more that is free.
_BOX = 6


class Superquadric:
    """
    Isopotential C(x) = sum (x_i / a_i)^(2 n_i) - 1, in the frame of a volume.

    :ivar axes: semi-axes [m]
    :ivar exponents: 2 n_i
    """

    def __init__(self, volume: Volume, around: float):
        """:param around: distance that is enclosed too [m]"""
        half = volume.half + volume.radius + around
        self._place, self._turn = volume.pose[:3], Rotation.from_quat(np.roll(volume.pose[3:], -1))
        if volume.kind == 'box':
            self.axes, self.exponents = half * 3.0 ** (1.0 / _BOX), np.full(3, _BOX)
        elif volume.kind == 'capsule':  # as cylinders in the source
            self.axes = half * [np.sqrt(2.0), np.sqrt(2.0), 2.0 ** 0.25]
            self.exponents = np.array([2, 2, 4])
        else:
            self.axes, self.exponents = half, np.full(3, 2)

    def inside(self, vector: np.ndarray, place: bool = False) -> np.ndarray:
        """A vector, or a place, in the frame of the volume."""
        return np.asarray(self._turn.inv().apply(vector - self._place if place else vector))

    def outside(self, vector: np.ndarray) -> np.ndarray:
        """A vector of that frame in the base."""
        return np.asarray(self._turn.apply(vector))

    def derivatives(self, x: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Isopotential, gradient and diagonal of the Hessian at a place in that frame."""
        m, a = self.exponents, self.axes
        return (max(float(((x / a) ** m).sum()) - 1.0, _LEAST), m * (x / a) ** (m - 1) / a,
                m * (m - 1) * (x / a) ** (m - 2) / a ** 2)


def static(shape: Superquadric, x: np.ndarray, gain: float, decay: float) -> np.ndarray:
    """Minus the gradient of U = A exp(-eta C) / C, eq. (12)."""
    value, gradient, _ = shape.derivatives(x)
    return np.asarray(gain * np.exp(-decay * value) * (decay / value + value ** -2) * gradient)


def dynamic(shape: Superquadric, x: np.ndarray, v: np.ndarray, gain: float, decay: float,
            power: float) -> np.ndarray:
    """Minus the gradient of U = lambda (-cos theta)^beta |v| / C^eta, where it is approached."""
    value, gradient, hessian = shape.derivatives(x)
    speed, steep = float(np.linalg.norm(v)), float(np.linalg.norm(gradient))
    if speed < 1e-12 or steep < 1e-12:
        return np.zeros(3)
    towards = -float(gradient @ v) / (speed * steep)
    if towards <= 0.0:
        return np.zeros(3)
    slope = -(hessian * v / steep - (gradient @ v) * hessian * gradient / steep ** 3) / speed
    return np.asarray(-gain * speed * value ** -decay * (
        power * towards ** (power - 1.0) * slope - decay * towards ** power * gradient / value))


class Potentials:
    """Coupling term of a classical movement primitive of positions; ``coupling`` as its peer's."""

    def __init__(self, volumes: Iterable[Volume], around: float, gain: float, decay: float = 1.0,
                 power: float | None = None):
        """
        Take the volumes.

        :param around: radius of the tool [m]
        :param power: beta of the dynamic potential; None: the static one
        """
        self._shapes = [Superquadric(volume, around) for volume in volumes]
        self._gain, self._decay, self._power = gain, decay, power

    def coupling(self, y: np.ndarray, yd: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Velocity, which is none, and acceleration.

        :param y: position
        :param yd: velocity
        """
        result = np.zeros(3)
        for shape in self._shapes:
            x = shape.inside(y, place=True)
            result += shape.outside(
                static(shape, x, self._gain, self._decay) if self._power is None else dynamic(
                    shape, x, shape.inside(yd), self._gain, self._decay, self._power))
        return np.zeros(3), result

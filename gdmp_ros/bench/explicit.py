"""
The older way on SPD(m): vectors carried to the start by matrix square roots in every cycle.

Source: Abu-Dakka, Kyrki 2020 (ICRA), as [GDMP] section 5.3 compares with it. Compiled like
ours, so that the methods are compared and not the languages.
"""
from __future__ import annotations

import math

import numpy as np

from gdmp_ros.compilation import compiled
from gdmp_ros.dmp import Skill
from gdmp_ros.dmp.forcing import basis, forcing
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds import spd
from gdmp_ros.manifolds.linalg import (
    congruence,
    copy_into,
    from_mandel,
    multiply,
    scratch,
    to_mandel,
)
from gdmp_ros.manifolds.operations import work_size
from gdmp_ros.manifolds.spectral import compose_pair, symmetric_eigen


@compiled
def _root(m, a, root, inverse, work):
    """Symmetric square root of ``a`` and its inverse."""
    vectors, values, left = scratch(work, 0, m), work[m * m:m * m + m], work[m * m + m:]
    copy_into(a, root)
    symmetric_eigen(m, root, values, vectors, left)
    for i in range(m):
        values[i] = math.sqrt(values[i])
    compose_pair(m, values, vectors, root, inverse)


@compiled
def _transporter(m, source, target, out, work):
    """``E = (T S⁻¹)^½`` with ``v ↦ E v Eᵀ``, through the square roots of S and of S^-½ T S^-½."""
    root, inverse, white, half = (scratch(work, 0, m), scratch(work, 1, m), scratch(work, 2, m),
                                  scratch(work, 3, m))
    rest = work[4 * m * m:]
    _root(m, source, root, inverse, rest)
    congruence(m, inverse, target, white, half)
    _root(m, white, half, out, rest)
    multiply(m, root, half, white)
    multiply(m, white, inverse, out)


@compiled
def _explicit_step(m, functions, weights, numbers, point, start, goal, velocity, offset, work):
    """One cycle of eqs. (17), (18) with all vectors at the start."""
    s, h, alpha_z, alpha_x = numbers[0], numbers[1], numbers[2], numbers[3]
    x, size = math.exp(-alpha_x * s), m * m
    carry, a, b, half = (scratch(work, 0, m), scratch(work, 1, m), scratch(work, 2, m),
                         scratch(work, 3, m))
    rest = work[4 * size:]
    force, seen, rest = (rest[:velocity.size], rest[velocity.size:2 * velocity.size],
                         rest[2 * velocity.size:])
    # Where the goal is, as a vector at the point, carried to the start.
    spd.apply(ops.LOG, m, point, goal, seen, rest)
    from_mandel(m, seen, 1.0, a)
    _transporter(m, point, start, carry, rest)
    congruence(m, carry, a, b, half)
    to_mandel(m, b, seen)
    forcing(functions, weights, s, x, force)
    for i in range(velocity.size):
        pull = seen[i] - offset[i] * x + force[i]
        velocity[i] += h * alpha_z * (0.25 * alpha_z * pull - velocity[i])
    # The step, carried back to the point.
    from_mandel(m, velocity, h, a)
    _transporter(m, start, point, carry, rest)
    congruence(m, carry, a, b, half)
    to_mandel(m, b, seen)
    spd.apply(ops.EXP, m, point, seen, point, rest)
    numbers[0] = s + h


class ExplicitTransport:
    """Steps a skill on SPD(m) this way."""

    def __init__(self, skill: Skill, dt: float = 1e-3):
        """:param skill: on SPD(m)"""
        manifold, size = skill.manifold, skill.manifold.tangent_size
        self._functions = basis(skill.n_basis, skill.gains.alpha_x)
        # As tangents at the start, where this method keeps all its vectors.
        self._weights = np.empty((skill.n_basis, size))
        for row, weights in zip(self._weights, np.array(skill.weights)):
            manifold._apply(ops.VECTOR, np.array(skill.frame), weights, row)
        self._numbers = np.array([0.0, dt / skill.duration, skill.gains.alpha_z,
                                  skill.gains.alpha_x])
        self._point, self._start = (np.array(skill.start).reshape(-1) for _ in range(2))
        self._goal, self._velocity = np.array(skill.goal).reshape(-1), np.zeros(size)
        self._offset = manifold.log(skill.start, skill.goal)
        self._work = np.empty(3 * work_size(skill.manifold.m))

    def step(self) -> None:
        """Advance by dt."""
        _explicit_step(math.isqrt(self._point.size), self._functions, self._weights,
                       self._numbers, self._point, self._start, self._goal, self._velocity,
                       self._offset, self._work)

"""Smallest singular value of a Jacobian, and whether a motion decreases it."""
from __future__ import annotations

import math

from gdmp_ros.kernels import kernel, local_numbers, local_zeros, noinline
from gdmp_ros.manifolds.spectral import symmetric_eigen

#: A rotation counts as the motion of a point at this distance from its axis [m].
ROTATION_LENGTH = 0.3


@kernel
def singular_value(jacobian, direction):
    """
    Smallest singular value of the Jacobian, rotations scaled by `ROTATION_LENGTH` [m].

    :param direction: result, its left singular vector, shape (6,)
    """
    noinline()
    n = jacobian.shape[1]
    square, values = local_numbers(36), local_numbers(6)
    vectors, work = local_numbers(36), local_numbers(36)
    for i in range(6):
        for j in range(6):
            total = 0.0
            for k in range(n):
                total += jacobian[i, k] * jacobian[j, k]
            square[6 * i + j] = (total * (ROTATION_LENGTH if i > 2 else 1.0)
                                 * (ROTATION_LENGTH if j > 2 else 1.0))
    symmetric_eigen(6, square, values, vectors, work)
    least = 0
    for i in range(1, 6):
        if values[i] < values[least]:
            least = i
    for i in range(6):
        direction[i] = vectors[6 * least + i]
    return math.sqrt(max(values[least], 0.0))


@kernel
def singular_rate(jacobian, velocity, direction):
    """
    Rate of half the squared smallest singular value of a chain of revolute joints.

    Column k of the Jacobian depends on joint i through the rotation of everything beyond joint i.

    :param velocity: of the joints, shape (n,)
    :param direction: left singular vector of `singular_value`
    """
    n = jacobian.shape[1]
    # Angular velocity of link k, and velocity of the tool relative to it.
    angular, beyond = local_zeros(3), local_zeros(3)
    for k in range(n):
        for i in range(3):
            beyond[i] += jacobian[i, k] * velocity[k]
    total = 0.0
    for k in range(n):
        z, j = jacobian[3:, k], jacobian[:3, k]
        # The joints before joint k rotate its axis.
        axis = 0.0
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            axis += direction[3 + i] * (angular[p] * z[q] - angular[q] * z[p])
        for i in range(3):
            angular[i] += z[i] * velocity[k]
            beyond[i] -= j[i] * velocity[k]
        linear, amount = 0.0, 0.0
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            linear += direction[i] * (angular[p] * j[q] - angular[q] * j[p]
                                      + z[p] * beyond[q] - z[q] * beyond[p])
            amount += direction[i] * j[i] + ROTATION_LENGTH * direction[3 + i] * z[i]
        total += amount * (linear + ROTATION_LENGTH * axis)
    return total

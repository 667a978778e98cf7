"""The manifold of a tool: pose and stiffness."""
from __future__ import annotations

from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite


def tool_manifold(stiffness_size: int | None) -> Product:
    """R³ × S³, with SPD(3) or SPD(6) if there is a stiffness."""
    factors: list[Manifold] = [Euclidean(3), UnitQuaternion()]
    if stiffness_size is not None:
        factors.append(SymmetricPositiveDefinite(stiffness_size))
    return Product(*factors, names=('position', 'orientation', 'stiffness')[:len(factors)])

"""The manifold of a tool: pose, stiffness, wrench."""
from __future__ import annotations

from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite


def tool_manifold(stiffness_size: int | None, wrench: bool = False) -> Product:
    """R³ × S³, with SPD(3) or SPD(6) if there is a stiffness, and R⁶ if there is a wrench."""
    factors: dict[str, Manifold] = {'position': Euclidean(3), 'orientation': UnitQuaternion()}
    if stiffness_size is not None:
        factors['stiffness'] = SymmetricPositiveDefinite(stiffness_size)
    if wrench:
        factors['wrench'] = Euclidean(6)
    return Product(*factors.values(), names=tuple(factors))

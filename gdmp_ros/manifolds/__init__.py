"""Geometry: points, tangents, geodesics, parallel transport."""
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.registry import from_spec
from gdmp_ros.manifolds.rotation import SpecialOrthogonal
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.manifolds.sphere import Sphere

__all__ = ['Euclidean', 'Manifold', 'Product', 'SpecialOrthogonal', 'Sphere',
           'SymmetricPositiveDefinite', 'UnitQuaternion', 'from_spec']

"""Geometry: points, tangents, geodesics, parallel transport; every manifold by its name."""
from __future__ import annotations

from collections.abc import Mapping

from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.rotation import SpecialOrthogonal
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.manifolds.sphere import Sphere

__all__ = ['Euclidean', 'from_spec', 'Manifold', 'Product', 'SpecialOrthogonal', 'Sphere',
           'SymmetricPositiveDefinite', 'UnitQuaternion']

#: Manifolds that files and parameters may name; a `Product` is made of them.
KINDS: tuple[type[Manifold], ...] = (
    Euclidean,
    Sphere,
    UnitQuaternion,
    SpecialOrthogonal,
    SymmetricPositiveDefinite,
)


def from_spec(spec: object) -> Manifold:
    """
    Build the manifold that `Manifold.spec` described.

    :raises DataError: if the description is malformed; the message lists the known kinds
    """
    if not isinstance(spec, Mapping) or 'kind' not in spec:
        raise DataError(f'manifold: expected an object with "kind", got {spec!r}')
    kind = spec['kind']
    if kind == Product.kind:
        factors = spec.get('factors')
        if not isinstance(factors, list) or not factors:
            raise DataError(f'manifold: a product needs a list "factors", got {factors!r}')
        return Product(*(from_spec(f) for f in factors), names=spec.get('names'))
    for known in KINDS:
        if known.kind == kind:
            return known.of_size(spec.get('m'))
    names = ', '.join([*(known.kind for known in KINDS), Product.kind])
    raise DataError(f'manifold: unknown kind {kind!r}, expected one of {names}')

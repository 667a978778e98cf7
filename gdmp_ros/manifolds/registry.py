"""
Which manifolds there are: a new one is its own file, one line in `KINDS` and one in `apply`.

Compiled code tells the manifolds apart by their place in `KINDS`; files and parameters by name.
"""
from __future__ import annotations

from typing import Any, Mapping

from gdmp_ros.compilation import compiled
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds import euclidean, quaternion, rotation, spd, sphere
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product

KINDS: tuple[Any, ...] = (
    euclidean.Euclidean,
    sphere.Sphere,
    quaternion.UnitQuaternion,
    rotation.SpecialOrthogonal,
    spd.SymmetricPositiveDefinite,
)


@compiled
def apply(kind, op, m, a, b, out):
    """Answer operation ``op`` for manifold number ``kind`` (`gdmp_ros.manifolds.operations`)."""
    if kind == 0:
        return euclidean.apply(op, m, a, b, out)
    if kind == 1:
        return sphere.apply(op, m, a, b, out)
    if kind == 2:
        return quaternion.apply(op, m, a, b, out)
    if kind == 3:
        return rotation.apply(op, m, a, b, out)
    return spd.apply(op, m, a, b, out)


def number_of(manifold: Manifold) -> int:
    """Place of a manifold's class in `KINDS`."""
    return KINDS.index(type(manifold))


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
            return known() if known is quaternion.UnitQuaternion else known(spec.get('m'))
    names = ', '.join([*(known.kind for known in KINDS), Product.kind])
    raise DataError(f'manifold: unknown kind {kind!r}, expected one of {names}')

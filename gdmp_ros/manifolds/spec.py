"""From the description of a manifold in a file or a parameter to the manifold."""
from __future__ import annotations

from collections.abc import Mapping

from gdmp_ros.errors import DataError
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.registry import KINDS


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
            made: Manifold = known() if known is UnitQuaternion else known(spec.get('m'))
            return made
    names = ', '.join([*(known.kind for known in KINDS), Product.kind])
    raise DataError(f'manifold: unknown kind {kind!r}, expected one of {names}')

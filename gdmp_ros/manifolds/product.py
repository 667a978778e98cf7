"""Products of manifolds: a pose is R³ × S³, a pose with stiffness R³ × S³ × S³_++."""
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gdmp_ros.errors import ManifoldError
from gdmp_ros.manifolds.manifold import earliest, Manifold


class Product(Manifold):
    """
    M1 × M2 × …: factor by factor, [GDMP] section 4.4.

    A point is one flat vector, the factors' points one after another (matrices row by row); a
    tangent is the factors' tangents one after another. The squared distance is the sum of the
    factors' squared distances.

    :ivar is_named: whether names were given, here or to a product among the factors
    """

    kind = 'product'

    def __init__(self, *factors: Manifold, names: Sequence[str] | None = None):
        """
        Join manifolds.

        :param factors: at least one; a product among them is replaced by its factors
        :param names: one for each factor; by default those that a product among them was given,
            and the kinds of the others, numbered where they repeat
        """
        if not factors or not all(isinstance(f, Manifold) for f in factors):
            raise ManifoldError(f'Product: expected one or more manifolds, got {factors!r}')
        self._factors = tuple(inner for f in factors for inner in f.factors)
        self.is_named: bool = names is not None or any(
            isinstance(f, Product) and f.is_named for f in factors)
        self._names = self._given_names(names, factors)
        super().__init__(len(self._factors), dim=sum(f.dim for f in self._factors),
                         point_shape=(sum(f.point_size for f in self._factors),),
                         tangent_size=sum(f.tangent_size for f in self._factors),
                         frame_size=sum(f.frame_size for f in self._factors))

    @property
    def factors(self) -> tuple[Manifold, ...]:
        return self._factors

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    @property
    def unit(self) -> str:  # type: ignore[override]
        """Units of the factors."""
        return ', '.join(f'{name}: {f.unit}' for name, f in zip(self._names, self._factors))

    def split(self, point: np.ndarray) -> tuple[np.ndarray, ...]:
        """Cut a point into its factors' points."""
        flat = self.flat(point)
        return tuple(flat[part].reshape(factor.point_shape)
                     for factor, part in zip(self._factors, self.point_slices))

    def join(self, *points: np.ndarray) -> np.ndarray:
        """Join factors' points to one point (the inverse of `split`)."""
        if len(points) != len(self._factors):
            raise self.error(f'{len(points)} points to join, expected {len(self._factors)}')
        return np.concatenate([f.flat(p) for f, p in zip(self._factors, points)])

    def spec(self) -> dict[str, object]:
        return {'kind': self.kind, 'factors': [f.spec() for f in self._factors],
                'names': list(self._names)}

    def align(self, point: np.ndarray, reference: np.ndarray) -> np.ndarray:
        return self.join(*(f.align(p, r) for f, p, r in zip(self._factors, self.split(point),
                                                            self.split(reference))))

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw each factor's point."""
        return self.join(*(f.random_point(rng) for f in self._factors))

    def nearest_point(self, array: np.ndarray) -> np.ndarray:
        return self.join(*(f.nearest_point(p) for f, p in zip(self._factors, self.split(array))))

    def first_invalid(self, points: np.ndarray) -> tuple[int, str] | None:
        results = ((name, factor.first_invalid(part)) for name, factor, part
                   in zip(self._names, self._factors, self._columns(points)))
        return earliest(*((result[0], f'{name}: {result[1]}') for name, result in results
                          if result))

    def continuous(self, points: np.ndarray) -> np.ndarray:
        return np.hstack([factor.continuous(part).reshape(len(points), -1)
                          for factor, part in zip(self._factors, self._columns(points))])

    def _columns(self, points: np.ndarray) -> list[np.ndarray]:
        return [points[:, part].reshape(-1, *factor.point_shape)
                for factor, part in zip(self._factors, self.point_slices)]

    def _given_names(self, names: Any, factors: Sequence[Manifold]) -> tuple[str, ...]:
        kinds = [name for factor in factors for name in (
            factor.names if isinstance(factor, Product) and factor.is_named
            else [inner.kind for inner in factor.factors])]
        if names is None:
            return tuple(kind if kinds.count(kind) == 1 else f'{kind}{kinds[:i].count(kind) + 1}'
                         for i, kind in enumerate(kinds))
        if (not isinstance(names, (list, tuple)) or len(names) != len(kinds)
                or len(set(map(str, names))) != len(kinds)):
            raise ManifoldError(f'Product: expected {len(kinds)} different names, got {names!r}')
        return tuple(str(name) for name in names)

    def __repr__(self) -> str:
        return ' × '.join(repr(f) for f in self._factors)

"""Products of manifolds: a pose is R³ × S³, a pose with stiffness R³ × S³ × S³_++."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.errors import CutLocusError, ManifoldError
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.registry import factor_table, map_factors, POINT, VECTOR, work_array


class Product(Manifold):
    """
    M1 × M2 × …: factor by factor, [GDMP] section 4.4.

    A point is one flat vector, the factors' points one after another (matrices row by row); a
    tangent is the factors' tangents one after another. Distances add in squares.
    """

    kind = 'product'

    def __init__(self, *factors: Manifold, names: Sequence[str] | None = None):
        """
        Join manifolds.

        :param factors: at least one; products among them are flattened
        :param names: one for each factor; their kinds by default, numbered where they repeat
        """
        if not factors or not all(isinstance(f, Manifold) for f in factors):
            raise ManifoldError(f'Product: expected one or more manifolds, got {factors!r}')
        self._factors = tuple(inner for f in factors for inner in f.factors)
        self._names = self._given_names(names)
        self._table = factor_table(self._factors)
        last = self._table[-1]
        super().__init__(len(self._factors), dim=sum(f.dim for f in self._factors),
                         point_shape=(int(last[POINT + 1]),), tangent_size=int(last[VECTOR + 1]),
                         frame_size=sum(f.frame_size for f in self._factors))

    @property
    def factors(self) -> tuple[Manifold, ...]:
        return self._factors

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    def split(self, point: np.ndarray) -> tuple[np.ndarray, ...]:
        """Cut a point into its factors' points."""
        flat = self._flat(point)
        return tuple(flat[a:b].reshape(factor.point_shape)
                     for factor, (a, b) in zip(self._factors, self._table[:, POINT:POINT + 2]))

    def join(self, *points: np.ndarray) -> np.ndarray:
        """Put factors' points together to one point (the inverse of `split`)."""
        if len(points) != len(self._factors):
            raise ManifoldError(f'{self!r}: {len(points)} points to join, '
                                f'expected {len(self._factors)}')
        return np.concatenate([f._flat(p) for f, p in zip(self._factors, points)])

    def spec(self) -> dict[str, object]:
        return {'kind': self.kind, 'factors': [f.spec() for f in self._factors],
                'names': list(self._names)}

    def align(self, point: np.ndarray, reference: np.ndarray) -> np.ndarray:
        return self.join(*(f.align(p, r) for f, p, r in zip(self._factors, self.split(point),
                                                            self.split(reference))))

    def random_point(self, rng: np.random.Generator) -> np.ndarray:
        """Draw each factor's point."""
        return self.join(*(f.random_point(rng) for f in self._factors))

    def _apply(self, op: int, a: np.ndarray, b: np.ndarray, out: np.ndarray) -> float:
        answer = np.empty(1)
        map_factors(self._table, op, a[None], b[None], out[None], answer, work_array(self._table))
        return float(answer[0])

    def _project(self, array: np.ndarray) -> np.ndarray:
        return self.join(*(f._project(p) for f, p in zip(self._factors, self.split(array))))

    def _defect(self, point: np.ndarray) -> str | None:
        for name, factor, part in zip(self._names, self._factors, self.split(point)):
            defect = factor._defect(part)
            if defect is not None:
                return f'{name}: {defect}'
        return None

    def _check_gap(self, gap: float) -> None:
        try:
            super()._check_gap(gap)
        except CutLocusError as error:
            raise CutLocusError(f'{error} (one of {", ".join(self._names)})', gap) from None

    def _given_names(self, names: Sequence[str] | None) -> tuple[str, ...]:
        kinds = [f.kind for f in self._factors]
        if names is None:
            return tuple(kind if kinds.count(kind) == 1 else f'{kind}{kinds[:i].count(kind) + 1}'
                         for i, kind in enumerate(kinds))
        if (not isinstance(names, (list, tuple)) or len(names) != len(kinds)
                or len(set(map(str, names))) != len(kinds)):
            raise ManifoldError(f'Product: expected {len(kinds)} different names, got {names!r}')
        return tuple(str(name) for name in names)

    def __repr__(self) -> str:
        return ' × '.join(repr(f) for f in self._factors)

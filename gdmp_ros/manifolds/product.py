"""Products of manifolds: a pose is R³ × S³, a pose with stiffness R³ × S³ × S³_++."""
from __future__ import annotations

from typing import Sequence

import numpy as np

from gdmp_ros.errors import CutLocusError, ManifoldError
from gdmp_ros.manifolds import operations as ops
from gdmp_ros.manifolds.manifold import Manifold

#: What `a`, `b` and `out` hold in each operation: P(oint), V(ector), F(rame) or nothing.
_LAYOUT = {ops.EXP: 'PVP', ops.LOG: 'PPV', ops.FRAME: 'P-F', ops.POINT: 'F-P', ops.MOVE: 'FV-',
           ops.FRAME_LOG: 'FPV', ops.VECTOR: 'FVV', ops.COORDS: 'FVV', ops.MEND: 'F--',
           ops.MEND_POINT: 'P--', ops.TANGENT: 'PVV'}


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
        sizes = {'P': [f.point_size for f in self._factors],
                 'V': [f.tangent_size for f in self._factors],
                 'F': [f.frame_size for f in self._factors], '-': [0] * len(self._factors)}
        ends = {key: np.cumsum([0, *values]) for key, values in sizes.items()}
        self._slices = {key: [slice(int(a), int(b)) for a, b in zip(end[:-1], end[1:])]
                        for key, end in ends.items()}
        super().__init__(len(self._factors), dim=sum(f.dim for f in self._factors),
                         point_shape=(int(ends['P'][-1]),), tangent_size=int(ends['V'][-1]),
                         frame_size=int(ends['F'][-1]))

    @property
    def factors(self) -> tuple[Manifold, ...]:
        return self._factors

    @property
    def names(self) -> tuple[str, ...]:
        return self._names

    @property
    def tangent_slices(self) -> list[slice]:
        """Where each factor's tangent lies in a tangent of the product."""
        return list(self._slices['V'])

    def split(self, point: np.ndarray) -> tuple[np.ndarray, ...]:
        """Cut a point into its factors' points."""
        flat = self._flat(point)
        return tuple(flat[part].reshape(factor.point_shape)
                     for factor, part in zip(self._factors, self._slices['P']))

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
        first, second, third = (self._slices[key] for key in _LAYOUT[op])
        return min(f._apply(op, a[i], b[j], out[k])
                   for f, i, j, k in zip(self._factors, first, second, third))

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
        if len(names) != len(kinds) or len(set(names)) != len(kinds):
            raise ManifoldError(f'Product: expected {len(kinds)} different names, got {names!r}')
        return tuple(str(name) for name in names)

    def __repr__(self) -> str:
        return ' × '.join(repr(f) for f in self._factors)

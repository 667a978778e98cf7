"""Everything the package raises on purpose: `GdmpError` and its few children."""
from __future__ import annotations


class GdmpError(Exception):
    """Something was refused; the message says what, where, the limit and what was got."""


class GdmpWarning(UserWarning):
    """Something was done, but not as it was asked for."""


class ManifoldError(GdmpError, ValueError):
    """An array is not a point or a tangent of the manifold it was given to."""


class InvalidPointError(ManifoldError):
    """
    One of several arrays is not a point.

    :ivar index: which one
    """

    def __init__(self, message: str, index: int):
        super().__init__(message)
        self.index = index


class CutLocusError(GdmpError, ValueError):
    """
    The logarithm is not unique.

    :ivar distance: how far the point is from the cut locus [rad]
    """

    def __init__(self, message: str, distance: float):
        super().__init__(message)
        self.distance = distance


class DataError(GdmpError, ValueError):
    """A bag, a skill file or a data set is damaged or does not hold what it should."""


class RefusedError(GdmpError):
    """An arm does not follow a reference; the message says why."""


class ParameterError(GdmpError, ValueError):
    """A parameter is outside its range."""

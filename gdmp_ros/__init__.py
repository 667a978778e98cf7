"""
Geometry-aware dynamic movement primitives: learn motions on manifolds, roll them out.

Every name is imported when it is first used, so that the command line starts without the library.
"""
from __future__ import annotations

from typing import Any, TYPE_CHECKING

if TYPE_CHECKING:
    from gdmp_ros.dmp import (
        Batch,
        Coupling,
        Demonstration,
        Gains,
        Options,
        Rollout,
        Skill,
        State,
        Trajectory,
    )
    from gdmp_ros.errors import (
        CutLocusError,
        DataError,
        GdmpError,
        GdmpWarning,
        ManifoldError,
        ParameterError,
    )
    from gdmp_ros.learning import fit_report
    from gdmp_ros.manifolds import (
        Euclidean,
        from_spec,
        Manifold,
        Product,
        SpecialOrthogonal,
        Sphere,
        SymmetricPositiveDefinite,
        UnitQuaternion,
    )

__version__ = '0.1.0'

__all__ = ['Batch', 'Coupling', 'CutLocusError', 'DataError', 'Demonstration', 'Euclidean',
           'fit_report', 'from_spec', 'Gains', 'GdmpError', 'GdmpWarning', 'Manifold',
           'ManifoldError', 'Options', 'ParameterError', 'Product', 'Rollout', 'Skill',
           'SpecialOrthogonal', 'Sphere', 'State', 'SymmetricPositiveDefinite', 'Trajectory',
           'UnitQuaternion']


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    import gdmp_ros.errors as errors
    if hasattr(errors, name):
        return getattr(errors, name)
    import gdmp_ros.manifolds as manifolds
    if hasattr(manifolds, name):
        return getattr(manifolds, name)
    import gdmp_ros.dmp as dmp
    if hasattr(dmp, name):
        return getattr(dmp, name)
    import gdmp_ros.learning as learning
    return getattr(learning, name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])

"""Geometry-aware dynamic movement primitives: learn, roll out, switch goals."""
from gdmp_ros.dmp import (
    Batch,
    Demonstration,
    fit_report,
    Gains,
    Options,
    Rollout,
    Skill,
    State,
    Trajectory,
)
from gdmp_ros.errors import CutLocusError, DataError, GdmpError, ManifoldError, ParameterError
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

__all__ = ['Batch', 'CutLocusError', 'DataError', 'Demonstration', 'Euclidean', 'fit_report',
           'from_spec', 'Gains', 'GdmpError', 'Manifold', 'ManifoldError', 'Options',
           'ParameterError', 'Product', 'Rollout', 'Skill', 'SpecialOrthogonal', 'Sphere', 'State',
           'SymmetricPositiveDefinite', 'Trajectory', 'UnitQuaternion']

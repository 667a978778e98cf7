"""Geometry-aware dynamic movement primitives: learn, roll out, switch goals."""
from gdmp_ros.dmp import Demonstration, Gains, Rollout, Skill, State, Trajectory
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

__all__ = ['CutLocusError', 'DataError', 'Demonstration', 'Euclidean', 'Gains', 'GdmpError',
           'Manifold', 'ManifoldError', 'ParameterError', 'Product', 'Rollout', 'Skill',
           'SpecialOrthogonal', 'Sphere', 'State', 'SymmetricPositiveDefinite', 'Trajectory',
           'UnitQuaternion', 'from_spec']

"""Stiffness profiles estimated from demonstrations."""
from gdmp_ros.stiffness.force import force_stiffness, ForceRecords
from gdmp_ros.stiffness.variance import (
    bounded_stiffness,
    Mixture,
    stiffness_along,
    variance_stiffness,
)

__all__ = ['ForceRecords', 'Mixture', 'bounded_stiffness', 'force_stiffness', 'stiffness_along',
           'variance_stiffness']

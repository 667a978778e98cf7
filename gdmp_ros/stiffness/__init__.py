"""Stiffness profiles estimated from demonstrations."""
from gdmp_ros.stiffness.variance import bounded_stiffness, Mixture, variance_stiffness

__all__ = ['Mixture', 'bounded_stiffness', 'variance_stiffness']

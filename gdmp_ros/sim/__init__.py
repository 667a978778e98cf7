"""Simulated robots: the only package that imports MuJoCo."""
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop

__all__ = ['Arm', 'ClosedLoop']

"""The primitive: learn a skill from demonstrations, roll it out. Knows manifolds, nothing else."""
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout, State
from gdmp_ros.dmp.skill import Gains, Skill, Trajectory

__all__ = ['Demonstration', 'Gains', 'Rollout', 'Skill', 'State', 'Trajectory']

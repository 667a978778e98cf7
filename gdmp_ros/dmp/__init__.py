"""The primitive: learn a skill from demonstrations, roll it out. Knows manifolds, nothing else."""
from gdmp_ros.dmp.batch import Batch
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.fit import Fit, fit_report
from gdmp_ros.dmp.rollout import Options, Rollout, State
from gdmp_ros.dmp.skill import Gains, Skill, Trajectory

__all__ = ['Batch', 'Demonstration', 'Fit', 'fit_report', 'Gains', 'Options', 'Rollout', 'Skill',
           'State', 'Trajectory']

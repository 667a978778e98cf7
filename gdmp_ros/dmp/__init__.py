"""The primitive: learn a skill from demonstrations, roll it out. Knows manifolds, nothing else."""
from gdmp_ros.dmp.batch import Batch
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.fit import Fit, fit_report
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Gains, Skill, Trajectory
from gdmp_ros.dmp.state import State

__all__ = ['Batch', 'Demonstration', 'Fit', 'fit_report', 'Gains', 'Options', 'Rollout', 'Skill',
           'State', 'Trajectory']

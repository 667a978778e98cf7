"""Movement primitives: a skill, its execution, goals, tempo; without ROS and simulator."""
from gdmp_ros.dmp.batch import Batch
from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.primitive import Gains, Trajectory
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.dmp.state import State

__all__ = ['Batch', 'Coupling', 'Demonstration', 'Gains', 'Options', 'Rollout', 'Skill', 'State',
           'Trajectory']

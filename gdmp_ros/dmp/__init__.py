"""Movement primitives: a skill, its execution, goals, tempo; without ROS and simulator."""
from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.primitive import Gains, State, Trajectory
from gdmp_ros.dmp.rollout import Batch, Rollout
from gdmp_ros.dmp.skill import Skill

__all__ = ['Batch', 'Coupling', 'Demonstration', 'Gains', 'Options', 'Rollout', 'Skill', 'State',
           'Trajectory']

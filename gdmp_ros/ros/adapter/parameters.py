"""Parameters of the adapter."""
from __future__ import annotations

from gdmp_ros.ros.parameters import Spec

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('reference_topic', '/trajectory_server/reference', 'gdmp_msgs/Reference to convert'),
    Spec('reference_frame', 'panda_link0', 'frame of the references; others are refused'),
    Spec('measured_pose_topic', 'measured_pose', 'geometry_msgs/PoseStamped of the tool: a motion '
         'is converted if it begins near the robot, or after ~/arm'),
    Spec('pose_topic', 'target_pose', 'geometry_msgs/PoseStamped of the controller; empty: none'),
    Spec('pose_rate_hz', 1000, 'largest rate of the poses', 'Hz', 1, 1000),
    Spec('frame_id', '', 'name of that frame in the controller, if it is another one; '
         'empty: the same'),
    Spec('stiffness', 'six', 'interface of the controller for the stiffness: none, six numbers '
         '(x y z rx ry rz) or a row-major 6x6 matrix in a Float64MultiArray, a WrenchStamped, or '
         'six parameters', choices=('none', 'six', 'matrix', 'wrench', 'parameters')),
    Spec('stiffness_topic', 'target_stiffness', 'topic of the stiffness'),
    Spec('stiffness_rate_hz', 1000, 'largest rate of the stiffness', 'Hz', 1, 1000),
    Spec('stiffness_frame', 'base', 'axes of the six numbers: those of the base or of the tool',
         choices=('base', 'tool')),
    Spec('stiffness_node', '', 'node with the six parameters'),
    Spec('stiffness_parameters', [''], 'names of the six parameters, x y z rx ry rz'),
    Spec('stiffness_min', [1.0, 0.1], 'smallest stiffness of the controller, translational and '
         'rotational', 'N/m, Nm/rad', 1e-3, 1e5),
    Spec('stiffness_max', [2000.0, 200.0], 'largest stiffness of the controller', 'N/m, Nm/rad',
         1e-3, 1e5),
    Spec('joint_names', [''], 'joints of a controller of joint trajectories, in the order of the '
         'references; empty: references of the joints are refused'),
    Spec('joint_trajectory_topic', 'joint_trajectory_controller/joint_trajectory',
         'trajectory_msgs/JointTrajectory of that controller'),
    Spec('joint_rate_hz', 100, 'largest rate of the trajectories', 'Hz', 1, 1000),
    Spec('joint_horizon', 0.03, 'a trajectory leads to where the joints will be after this time: '
         'longer than the period of joint_rate_hz', 's', 0.001, 1.0),
    Spec('measured_joints_topic', 'joint_states', 'sensor_msgs/JointState of the robot: a motion '
         'of the joints is converted if it begins near the robot, or after ~/arm'),
    Spec('realtime_priority', -1, 'SCHED_FIFO priority of the loop; -1: 40 if the system grants '
         'it; 0: never', low=-1, high=99),
)

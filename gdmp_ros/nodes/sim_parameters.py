"""Parameters of the simulated Panda."""
from gdmp_ros.nodes.parameters import Spec

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('model', '', 'MJCF file of another arm with one torque motor per joint; empty: the '
         'built-in Panda'),
    Spec('tool_site', 'tcp', 'site of the model that is controlled'),
    Spec('frame_id', 'panda_link0', "frame of the robot's base; references in others are refused"),
    Spec('reference_topic', 'trajectory_server/reference', 'gdmp_msgs/Reference to follow'),
    Spec('pace', 'wall', 'in step with wall time, or as fast as it can with /clock',
         choices=('wall', 'fast')),
    Spec('headless', True, 'without a viewer window'),
    Spec('viewer_rate_hz', 100, 'joint states, measured pose and stiffness for viewers', 'Hz', 1,
         100),
    Spec('reference_timeout', 0.1, 'without a reference for this long the arm stops and holds',
         's', 0.005, 10.0),
    Spec('stop_time', 0.3, 'the speed of the last reference fades over this', 's', 0.01, 5.0),
    Spec('fade_time', 0.5, 'a difference to a stream that appears fades over this', 's', 0.01,
         10.0),
    Spec('damping_ratio', 0.7, 'while holding without a reference; 1 is critical', low=0.0,
         high=2.0),
    Spec('torque_rate', 1.0, 'largest change of a joint torque per tick', 'Nm', 0.01, 100.0),
    Spec('position_clip', 0.1, 'largest position error acted upon', 'm', 0.001, 1.0),
    Spec('rotation_clip', 0.5, 'largest rotation error acted upon', 'rad', 0.01, 3.0),
    Spec('posture_stiffness', 5.0, 'of the posture in the null space', 'Nm/rad', 0.0, 100.0),
    Spec('posture_damping', 2.0, 'in the null space', 'Nm s/rad', 0.0, 50.0),
    Spec('feed_forward', True, "add the inertial force and the joint friction of the reference's "
         'motion'),
    Spec('realtime_priority', 0, 'SCHED_FIFO priority of the simulation thread; -1: 40 if the '
         'system grants it; 0: never', low=-1, high=99),
    Spec('lateness_file', '', 'NumPy file for deadline and lateness of all ticks'),
)

"""
Two simulated arms and the trajectory server that streams one skill of two arms to both.

    ros2 launch gdmp_ros two_arms.launch.py skill:=$PWD/both.json second_base:='0 -0.56 0 0 0 0'
"""
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from gdmp_ros.ros.arm_choice import ArmChoice
from launch import LaunchDescription

#: Names of the arms, and the topics of their references.
SIDES = (('left', 'reference'), ('right', 'second/reference'))
#: Links that may come near the other arm.
HANDS = ('hand', 'left_finger', 'right_finger')
#: Name, default, what it is.
ARGUMENTS = (
    ('skill', '', 'skill file of two arms to load'),
    ('second_base', '0 -0.56 0 0 0 0', 'base of the right arm in the frame of the left one: x y z '
     '[m] yaw pitch roll [rad]'),
    ('headless', 'true', "without the simulations' windows"),
    ('gripper', 'false', 'with grippers'),
)


def start(context):
    """Make the nodes."""
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    # Looked up before anything is started.
    FindPackageShare('tf2_ros').perform(context)
    numbers = given['second_base'].split()
    if len(numbers) != 6:
        raise ValueError(f"second_base is {given['second_base']!r}, expected 6 numbers")
    on = {name: given[name].lower() in ('true', '1') for name in ('headless', 'gripper')}
    share = FindPackageShare('gdmp_ros').perform(context)
    wired = ArmChoice().server_parameters()

    def node(name, values, namespace='', remappings=()):
        return Node(package='gdmp_ros', executable=name, name=name, namespace=namespace,
                    output='screen', parameters=[f'{share}/config/{name}.yaml', values],
                    remappings=remappings)

    others = dict(zip(dict(SIDES), reversed(dict(SIDES))))
    wanted = {side: {'frame_id': f'{side}_link0', 'reference_topic': f'/trajectory_server/{topic}',
                     # But for the hands, which may hold one thing.
                     'other_arms': [f'/{others[side]}/panda_sim/body'],
                     'other_arms_allowed': list(HANDS), **on} for side, topic in SIDES}
    return [
        *(node('panda_sim', values, side) for side, values in wanted.items()),
        node('trajectory_server', {
            'skill': given['skill'], 'frame_id': 'left_link0', 'second_frame_id': 'right_link0',
            **{name: f'left/{topic}' for name, topic in wired.items()},
            'second_measured_pose_topic': f'right/{wired["measured_pose_topic"]}'},
            # A skill of two arms has commands for the gripper of the first one.
            remappings=[(f'gripper/{name}', f'left/gripper/{name}')
                        for name in ('command', 'state')]),
        Node(package='tf2_ros', executable='static_transform_publisher', arguments=[
            *numbers, 'left_link0', 'right_link0'])]


def generate_launch_description():
    """Describe the arguments, and what they start."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        OpaqueFunction(function=start)])

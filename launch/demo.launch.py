"""Both nodes: a trajectory server and the simulated Panda it drives."""
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode, Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    """Describe the two nodes and their arguments."""
    namespace = LaunchConfiguration('namespace')

    def config(name):
        return PathJoinSubstitution([FindPackageShare('gdmp_ros'), 'config', name])

    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='namespace of both nodes'),
        DeclareLaunchArgument('skill', default_value='', description='skill file to load'),
        DeclareLaunchArgument('headless', default_value='true',
                              description="without the simulation's window"),
        DeclareLaunchArgument('use_rviz', default_value='false', description='start RViz'),
        LifecycleNode(package='gdmp_ros', executable='panda_sim', name='panda_sim',
                      namespace=namespace, output='screen',
                      parameters=[config('panda_sim.yaml'),
                                  {'headless': LaunchConfiguration('headless')}]),
        LifecycleNode(package='gdmp_ros', executable='trajectory_server', name='trajectory_server',
                      namespace=namespace, output='screen',
                      parameters=[config('trajectory_server.yaml'),
                                  {'skill': LaunchConfiguration('skill'),
                                   'measured_pose_topic': 'panda_sim/measured_pose'}]),
        Node(package='rviz2', executable='rviz2', name='rviz2', namespace=namespace,
             condition=IfCondition(LaunchConfiguration('use_rviz'))),
    ])

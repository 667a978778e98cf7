"""
Several robots, each with its nodes in a namespace of its own, with its own base frame.

    ros2 launch gdmp_ros several.launch.py robots:='left right' skill:=$PWD/skill.json
    ros2 launch gdmp_ros several.launch.py robots:='left right' arm:=franka \
        hosts:='172.16.0.2 172.17.0.2' skill:=$PWD/skill.json
"""
from pathlib import Path
import runpy

from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription

#: Arguments of one robot that are the same for all of them.
SHARED = [argument for argument in runpy.run_path(
              str(Path(__file__).with_name('arm.launch.py')))['ARGUMENTS']
          if argument[0] not in ('namespace', 'base_frame', 'host')]


def start(context):
    """Include the launch file of one robot for each; other arguments go on to all of them."""
    path = FindPackageShare('gdmp_ros').perform(context) + '/launch/arm.launch.py'
    robots = LaunchConfiguration('robots').perform(context).split()
    if context.launch_configurations.get('use_sim_time', 'false').lower() in ('true', '1'):
        raise ValueError('use_sim_time with several robots: each simulation would publish a '
                         '/clock of its own; give one robot, or leave it out')
    hosts = LaunchConfiguration('hosts').perform(context).split()
    if hosts and len(hosts) != len(robots):
        raise ValueError(f'hosts has {len(hosts)} addresses, expected {len(robots)}, one for each '
                         'of the robots')
    return [IncludeLaunchDescription(path, launch_arguments={
        'namespace': robot, 'base_frame': f'{robot}_link0', 'host': host}.items())
        for robot, host in zip(robots, hosts or [''] * len(robots))]


def generate_launch_description():
    """Describe the robots."""
    return LaunchDescription([
        DeclareLaunchArgument('robots', default_value='left right',
                              description='namespaces, one for each robot'),
        DeclareLaunchArgument('hosts', default_value='',
                              description='addresses, one for each robot, with arm:=franka'),
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in SHARED),
        OpaqueFunction(function=start)])

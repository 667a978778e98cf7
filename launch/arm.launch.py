"""
One robot: trajectory server, simulated arm or Franka, what shows them.

    ros2 launch gdmp_ros arm.launch.py skill:=$PWD/skill.json use_rviz:=true
    ros2 launch gdmp_ros arm.launch.py skill:=$PWD/skill.json arm:=franka host:=172.16.0.2
    ros2 launch gdmp_ros arm.launch.py namespace:=left base_frame:=left_link0
    ros2 launch gdmp_ros arm.launch.py composed:=true
"""
import json

from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from gdmp_ros.ros.arm_choice import ArmChoice
from launch import LaunchDescription

#: Nodes of the arms.
ARMS = {kind: ArmChoice(kind).node for kind in ('sim', 'franka')}
#: Name, default, what it is.
ARGUMENTS = (
    ('namespace', '', 'of all nodes'),
    ('skill', '', 'skill file to load'),
    ('headless', 'true', "without the simulation's window"),
    ('use_rviz', 'false', 'start RViz'),
    ('arm', 'sim', 'sim: simulated arm; franka: a Franka Research 3'),
    ('host', '', 'address of the Franka'),
    ('gripper', 'false', 'with a gripper'),
    ('start_arm', 'true', 'start the arm; false: a robot publishes measured_pose_topic'),
    ('use_sim_time', 'false', 'follow /clock: the simulation then runs as fast as it can, and a '
     'Franka publishes the time of the robot'),
    ('composed', 'false', 'all nodes in one process'),
    ('visualize', 'true', 'start the visualizer: markers, handles'),
    ('model', '', 'another arm: MJCF file, menagerie:NAME, robot_descriptions:NAME'),
    ('base_frame', 'panda_link0', "frame of the robot's base"),
    ('measured_pose_topic', '', 'where motions start; empty: that of the arm'),
    ('params_file', '', 'parameter file that comes last'),
)


def start(context):
    """Make the nodes that the arguments ask for."""
    given = {name: LaunchConfiguration(name).perform(context) for name, _, _ in ARGUMENTS}
    on = {}
    for name in ('headless', 'use_rviz', 'start_arm', 'use_sim_time', 'composed', 'visualize',
                 'gripper'):
        if given[name].lower() not in ('true', 'false', '1', '0'):
            raise ValueError(f'{name} is {given[name]!r}, expected true or false')
        on[name] = given[name].lower() in ('true', '1')
    if given['arm'] not in ARMS:
        raise ValueError(f"arm is {given['arm']!r}, expected one of {', '.join(ARMS)}")
    if (given['arm'] == 'franka' and on['start_arm']) != bool(given['host']):
        raise ValueError('arm:=franka needs host, the address of the robot, and sim has none')
    arm = ARMS[given['arm']]
    share = FindPackageShare('gdmp_ros').perform(context)
    frame = {'frame_id': given['base_frame'], 'use_sim_time': on['use_sim_time']}
    wanted = {}
    if on['start_arm']:
        # The one that makes the simulated time must not wait for it.
        if given['arm'] == 'franka':
            wanted['franka_arm'] = {**frame, 'use_sim_time': False, 'host': given['host'],
                                    'publish_clock': on['use_sim_time']}
            if on['gripper']:
                wanted['franka_gripper'] = {'host': given['host'], 'use_sim_time': False}
        else:
            wanted['panda_sim'] = {**frame, 'use_sim_time': False, 'headless': on['headless'],
                                   'model': given['model'], 'gripper': on['gripper'],
                                   'pace': 'fast' if on['use_sim_time'] else 'wall'}
    wired = ArmChoice(given['arm']).server_parameters()
    if given['measured_pose_topic']:
        wired['measured_pose_topic'] = given['measured_pose_topic']
    model = given['model'] or wired.get('reach_model', '')
    wanted['trajectory_server'] = {**frame, 'skill': given['skill'], **wired,
                                   'reach_model': model}
    if on['visualize'] or on['use_rviz']:
        wanted['visualizer'] = {**frame, 'model': model, 'arm': arm}
    last = [given['params_file']] if given['params_file'] else []

    def config(name):
        return f'{share}/config/{name}.yaml'

    common = {'namespace': given['namespace'], 'output': 'screen'}
    # libfranka would stop the other nodes of a process while it waits.
    alone = [name for name in wanted if name.startswith('franka_') or not on['composed']]
    result = [Node(package='gdmp_ros', executable=name, name=name,
                   parameters=[config(name), wanted[name], *last], **common) for name in alone]
    if on['composed']:
        wanted = {name: values for name, values in wanted.items() if name not in alone}
        # Whatever comes later wins: files given as `parameters` would come after these words.
        words = [word for name, values in wanted.items() for word in (
            '--params-file', config(name),
            *(part for key, value in values.items()
              for part in ('-p', f'{name}:{key}:={json.dumps(value)}')))]
        words += [word for path in last for word in ('--params-file', path)]
        result.append(Node(package='gdmp_ros', executable='composed', arguments=list(wanted),
                           ros_arguments=words, **common))
    if on['use_rviz']:
        result.append(Node(package='rviz2', executable='rviz2', name='rviz2', arguments=[
            '-d', f'{share}/config/gdmp.rviz', '-f', given['base_frame']], **common))
    return result


def generate_launch_description():
    """Describe the arguments, and what they start."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in ARGUMENTS),
        OpaqueFunction(function=start)])

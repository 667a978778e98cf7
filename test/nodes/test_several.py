"""Several robots from one process, and a robot that is kept from following."""
from gdmp_msgs.msg import Reference, ServerState
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import Trigger

from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import reliable

SERVER = 'gdmp_ros.ros.server.node'


def test_two_robots_are_streamed_by_one_process_each_in_its_namespace(world):
    world.children.start('both', SERVER, [
        '--robots', 'left', 'right', '--ros-args', '-p', f"skill:='{world.skill_file}'",
        '-p', 'start_from:=skill'])
    streams, states = {'left': [], 'right': []}, {}
    for name, into in streams.items():
        world.collect(Reference, f'/{name}/trajectory_server/reference', into)
        world.node.create_subscription(
            ServerState, f'/{name}/trajectory_server/state',
            lambda message, name=name: states.__setitem__(name, message), reliable(10))
    world.operator.wait('both servers', lambda: len(states) == 2, 60.0)
    assert world.call(Trigger, '/left/trajectory_server/start').success
    world.operator.wait('the left stream', lambda: len(streams['left']) > 500, 20.0)
    assert not streams['right']
    assert world.call(Trigger, '/right/trajectory_server/start').success
    world.operator.wait('the right stream', lambda: len(streams['right']) > 1000, 20.0)
    for messages in streams.values():
        numbers = [m.sequence for m in messages]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert world.call(Trigger, '/left/trajectory_server/stop').success
    world.operator.wait('the left one to stop', lambda: states['left'].status == 'holding', 10.0)
    before = len(streams['right'])
    world.operator.wait('the right one to go on', lambda: len(streams['right']) > before + 300,
                        10.0)
    # One thread ticks both, however fast the machine lets it.
    assert abs(states['left'].ticks - states['right'].ticks) < 1000


def test_the_reference_waits_for_a_robot_that_is_held_back(world, skill):
    world.start_server(measured_pose_topic='/held_robot', phase_stopping=5.0)
    start = skill.manifold.split(skill.start)
    pose = np.concatenate([start[0], start[1]])
    robot = world.node.create_publisher(PoseStamped, '/held_robot', reliable(10))

    def measured():
        message = PoseStamped()
        message.header.frame_id = 'panda_link0'
        messages.set_pose(message.pose, pose)
        robot.publish(message)

    world.node.create_timer(0.02, measured)
    world.operator.wait_status('holding', 60.0)
    world.operator.execute()
    world.operator.wait('the tempo to fall', lambda: world.operator.state.status == 'moving'
                        and 0.0 < world.operator.state.speed < 0.3, 20.0)
    slowed = world.operator.state.progress
    assert slowed < 0.6
    # Let go, the robot is where the reference is, and the motion takes up its tempo again.
    world.listen()

    def follows():
        if world.references:
            pose[:] = messages.pose_numbers(world.references[-1].pose)
        return world.operator.state.progress >= 1.0

    world.operator.wait('the motion to go on', follows, 30.0)

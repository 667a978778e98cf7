"""Several robots from one process, and a robot that cannot follow."""
from gdmp_msgs.msg import Reference, ServerState
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import Trigger

from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import SERVER
from test.ros.nodes import FRAME


def test_two_servers_stream_each_in_its_namespace(nodes):
    for name in ('left', 'right'):
        nodes.start_server(name, ['-r', f'__ns:=/{name}'], start_from='skill')
    streams, states = {}, {}
    for name in ('left', 'right'):
        streams[name] = nodes.collect(Reference, f'/{name}/{SERVER}/reference')
        nodes.subscribe(ServerState, f'/{name}/{SERVER}/state',
                        lambda message, name=name: states.__setitem__(name, message))
    nodes.wait('both servers', lambda: len(states) == 2, 60.0)
    assert nodes.call(Trigger, f'/left/{SERVER}/start').success
    nodes.wait('the left stream', lambda: len(streams['left']) > 500, 20.0)
    assert not streams['right']
    assert nodes.call(Trigger, f'/right/{SERVER}/start').success
    nodes.wait('the right stream', lambda: len(streams['right']) > 1000, 20.0)
    for received in streams.values():
        numbers = [m.sequence for m in received]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert nodes.call(Trigger, f'/left/{SERVER}/stop').success
    nodes.wait('the left one to stop', lambda: states['left'].status == 'holding', 10.0)
    before = len(streams['right'])
    nodes.wait('the right one to continue', lambda: len(streams['right']) > before + 300, 10.0)
    # One thread ticks both, at the rate that the machine reaches.
    assert abs(states['left'].ticks - states['right'].ticks) < 1000


def test_the_reference_waits_for_a_robot_that_is_held_back(nodes, skill):
    nodes.start_server(measured_pose_topic='/held_robot', phase_stopping=5.0)
    start = skill.manifold.split(skill.start)
    pose = np.concatenate([start[0], start[1]])
    robot = nodes.publisher(PoseStamped, '/held_robot')

    def publish():
        message = PoseStamped()
        message.header.frame_id = FRAME
        messages.set_pose(message.pose, pose)
        robot.publish(message)

    nodes.every(0.02, publish)
    nodes.client.wait_status('holding', 60.0)
    nodes.client.execute()
    nodes.wait('the tempo to decrease', lambda: nodes.state.status == 'moving'
               and 0.0 < nodes.state.speed < 0.3, 20.0)
    assert nodes.state.progress < 0.6
    # Released, the robot is where the reference is, and the motion continues.
    nodes.listen()

    def follows():
        if nodes.references:
            pose[:] = messages.pose_numbers(nodes.references[-1].pose)
        return nodes.state.progress >= 1.0

    nodes.wait('the motion to continue', follows, 30.0)

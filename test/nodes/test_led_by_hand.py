"""Takes are recorded by service, and a session of teaching ends in a skill."""

from gdmp_msgs.msg import RecorderState
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros import Skill
from gdmp_ros.data import recordings
from gdmp_ros.data import takes
from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import reliable
from test.commands import gdmp

RECORDER = 'take_recorder'


def test_takes_are_begun_ended_and_dropped_by_service(world, tmp_path):
    folder, states = tmp_path / 'takes', []
    world.node.create_subscription(RecorderState, f'{RECORDER}/state', states.append,
                                   reliable(10))
    world.children.start_node(RECORDER, 'gdmp_ros.ros.recorder.node', {
        'folder': str(folder), 'storage': 'sqlite3',
        'also': ['/panda_sim/state=gdmp_msgs/msg/RobotState']})
    world.wait('the recorder', lambda: bool(states), 60.0)
    assert states[-1].status == 'waiting'  # nothing has come on its topics
    idle = world.call(Trigger, f'{RECORDER}/stop')
    assert not idle.success and 'nothing is being recorded' in idle.message
    world.start_sim()
    world.wait('its topics', lambda: states[-1].status == 'ready', 60.0)
    for number in (1, 2):
        assert world.call(Trigger, f'{RECORDER}/start').message == f'recording take_00{number}'
        assert not world.call(Trigger, f'{RECORDER}/start').success
        world.spin(1.0)
        assert states[-1].status == 'recording' and states[-1].messages > 500
        assert world.call(Trigger, f'{RECORDER}/stop').success
    put = world.call(Trigger, f'{RECORDER}/discard').message
    assert put == f'put aside: {folder}/dropped/take_002'
    assert not world.call(Trigger, f'{RECORDER}/discard').success  # never one of before
    world.call(Trigger, f'{RECORDER}/start')
    assert 'while it was being recorded' in world.call(Trigger, f'{RECORDER}/discard').message
    world.spin(0.3)
    assert list(states[-1].takes) == ['take_001']
    assert sorted(p.name for p in folder.iterdir()) == ['dropped', 'take_001']
    found = {topic: count for topic, _, count in recordings.bags.topics(folder / 'take_001')}
    assert found['/panda_sim/measured_pose'] > 80 and found['/panda_sim/state'] > 800
    # Stopped in the middle of a take, it keeps what there is.
    world.call(Trigger, f'{RECORDER}/start')
    world.spin(0.5)
    assert world.children.stop(RECORDER) == 0
    assert [p.name for p in takes.folder_of(folder)] == ['take_001', 'take_002']


def test_a_led_arm_refuses_references_and_lets_go_of_a_hand_that_is_gone(world):
    world.start()
    assert 'weightless' in world.call(SetBool, 'panda_sim/teach', data=True).message
    world.wait('references to be refused', lambda: 'led by hand' in world.log('panda_sim'))
    hand = world.node.create_publisher(PoseStamped, 'panda_sim/hand_pose', reliable(1))
    world.wait('the hand', lambda: hand.get_subscription_count() > 0)
    place = world.tool()
    goal = place + np.array([0.06, 0.08, 0.0, 0.0, 0.0, 0.0, 0.0])
    message = PoseStamped()
    message.header.frame_id = 'panda_link0'
    messages.set_pose(message.pose, goal)

    def arrived():
        hand.publish(message)
        return np.linalg.norm(world.tool()[:3] - goal[:3]) < 0.01
    world.wait('the arm to follow the hand', arrived)
    message.header.frame_id = 'elsewhere'
    hand.publish(message)
    world.wait('the bad hand to be refused', lambda: 'hand_pose refused' in world.log('panda_sim'))
    assert world.call(SetBool, 'panda_sim/teach', data=False).message == (
        'the arm holds where it is')
    # The server still streams where the arm was: it is caught up with at a bounded speed.
    before = len(world.robot)
    world.wait('the arm to be back',
               lambda: np.linalg.norm(world.tool()[:3] - place[:3]) < 0.003)
    fastest = max(np.linalg.norm([m.twist.linear.x, m.twist.linear.y, m.twist.linear.z])
                  for m in world.robot[before:])
    assert fastest < 0.3


def test_from_nothing_to_a_taught_skill(tmp_path):
    folder, skill = tmp_path / 'takes', tmp_path / 'skill.json'
    done = gdmp('teach', '-o', folder, '--takes', 2, '--letter', 'Angle')
    assert done.returncode == 0, done.stderr
    assert [p.name for p in takes.folder_of(folder)] == ['take_001', 'take_002']
    listed = gdmp('takes', folder, '--plot', tmp_path / 'takes.png')
    assert listed.returncode == 0 and (tmp_path / 'takes.png').stat().st_size > 5000
    assert gdmp('learn', folder, '-o', skill).returncode == 0
    taught = Skill.load(skill)
    assert taught.manifold.names == ('position', 'orientation', 'stiffness')
    assert taught.provenance['stiffness'] == 'variance'
    more = gdmp('teach', '-o', folder, '--by-hand', '--no-window', given='\n\nd\nx\nd\nq\n')
    assert more.returncode == 0, more.stderr
    assert 'recording take_003' in more.stdout and 'dropped/take_003' in more.stdout
    assert 'no take of this session' in more.stdout and 'Enter begins a take' in more.stdout
    assert [p.name for p in takes.folder_of(folder)] == ['take_001', 'take_002']

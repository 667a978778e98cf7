"""Hand guiding: takes are recorded by service, and in a session at the terminal."""
from diagnostic_msgs.msg import DiagnosticArray
from gdmp_msgs.action import ExecuteSkill
from gdmp_msgs.msg import RecorderState, RobotState
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.data import bags, takes
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, MODULES, TAKE_RECORDER
from test.ros.nodes import FRAME


def test_takes_are_started_stopped_and_discarded_by_service(running, tmp_path):
    folder, states = tmp_path / 'takes', []
    running.subscribe(RecorderState, f'{TAKE_RECORDER}/state', states.append)
    running.children.start_node(TAKE_RECORDER, MODULES[TAKE_RECORDER], {
        'folder': str(folder), 'storage': 'sqlite3',
        'also': ['/panda_sim/state=gdmp_msgs/msg/RobotState',
                 '/late=geometry_msgs/msg/PoseStamped']})
    late = running.publisher(PoseStamped, '/late')
    running.wait('the recorder', lambda: bool(states), 60.0)
    assert states[-1].status == 'waiting'  # nothing has arrived on one of its topics
    idle = running.call(Trigger, f'{TAKE_RECORDER}/stop')
    assert not idle.success and 'nothing is being recorded' in idle.message

    def ready():
        late.publish(PoseStamped())
        return states[-1].status == 'ready'
    running.wait('all topics', ready, 60.0)
    for number in (1, 2):
        started = running.call(Trigger, f'{TAKE_RECORDER}/start')
        assert started.message == f'recording take_00{number}'
        assert not running.call(Trigger, f'{TAKE_RECORDER}/start').success
        running.wait('messages', lambda number=number: states[-1].messages > 500
                     and states[-1].take == f'take_00{number}')
        assert states[-1].status == 'recording'
        stopped = running.call(Trigger, f'{TAKE_RECORDER}/stop')
        assert stopped.success and 'no message on /late' in stopped.message
    moved = running.call(Trigger, f'{TAKE_RECORDER}/discard').message
    assert moved == f'moved to {folder}/dropped/take_002'
    assert not running.call(Trigger, f'{TAKE_RECORDER}/discard').success  # never an earlier one
    running.call(Trigger, f'{TAKE_RECORDER}/start')
    discarded = running.call(Trigger, f'{TAKE_RECORDER}/discard').message
    assert 'while it was being recorded' in discarded
    running.wait('the list of takes', lambda: list(states[-1].takes) == ['take_001'])
    assert sorted(p.name for p in folder.iterdir()) == ['dropped', 'take_001']
    found = {topic: count for topic, _, count in bags.topics(folder / 'take_001')}
    assert found['/panda_sim/measured_pose'] > 20 and found['/panda_sim/state'] > 300
    # A take is kept when the recorder is stopped in the middle of it.
    running.call(Trigger, f'{TAKE_RECORDER}/start')
    running.wait('messages', lambda: states[-1].status == 'recording' and states[-1].messages > 9)
    assert running.children.stop(TAKE_RECORDER) == 0
    assert [p.name for p in takes.takes_in(folder)] == ['take_001', 'take_002']


def test_a_guided_arm_refuses_references_and_releases_a_hand_that_is_silent(running):
    begun = running.call(SetBool, f'{ARM}/teach', data=True).message
    assert 'only gravity is compensated' in begun
    running.client.execute()
    running.wait('references to be refused', lambda: 'guided by hand' in running.log(ARM))
    assert running.client.result(30.0).error_code == ExecuteSkill.Result.BLOCKED
    status = []
    running.subscribe(DiagnosticArray, '/diagnostics', lambda message: status.extend(
        one.message for one in message.status if one.name.startswith(ARM)))
    hand = running.publisher(PoseStamped, f'{ARM}/hand_pose')
    start = running.tool()
    goal = start + np.array([0.06, 0.08, 0.0, 0.0, 0.0, 0.0, 0.0])
    message = PoseStamped()
    message.header.frame_id = FRAME
    messages.set_pose(message.pose, goal)

    def arrived():
        hand.publish(message)
        return np.linalg.norm(running.tool()[:3] - goal[:3]) < 0.01
    running.wait('the arm to follow the hand', arrived)
    assert 'guided by hand' in status[-1]
    message.header.frame_id = 'elsewhere'
    hand.publish(message)
    running.wait('the wrong pose to be refused', lambda: 'hand_pose refused' in running.log(ARM))
    # Nothing more comes from the hand.
    running.wait('the hand to be released', lambda: 'waiting for a hand' in status[-1])
    ended = running.call(SetBool, f'{ARM}/teach', data=False).message
    assert ended == 'no hand guides the arm'
    # The server still streams a pose away from it: the arm holds where the hand left it.
    running.spend(1.0)
    left = running.tool()
    running.spend(1.0)
    assert np.linalg.norm(running.tool()[:3] - left[:3]) < 1e-3
    assert np.linalg.norm(left[:3] - start[:3]) > 0.05
    assert running.robot[-1].mode == RobotState.HOLD
    # A motion begins at the robot, so it is followed.
    running.client.execute()
    running.wait('the arm to follow', lambda: running.robot[-1].mode == RobotState.FOLLOW)

"""Objects on /tf: the server follows them while a motion goes on, and the arm with it."""
import random

from gdmp_msgs.action import ExecuteSkill
from geometry_msgs.msg import TransformStamped
import numpy as np
import pytest
from tf2_msgs.msg import TFMessage

from gdmp_ros import Demonstration, Skill
from gdmp_ros.manifolds.poses import compose, inverse
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import SERVER
from gdmp_ros.ros.middleware import best_effort, reliable
from test.ros.nodes import FRAME
from test.ros.test_frames import static_broadcaster, transform

NS = 1_000_000_000
SPEED, LATENCY_S, PERIOD_NS = 0.05, 0.08, NS // 30


def pose(x, y, z):
    return np.array([x, y, z, 1.0, 0.0, 0.0, 0.0])


#: The camera stands beside the robot and looks along its x axis.
CAMERA = np.array([0.0, -0.8, 0.5, np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])


class Camera:
    """
    Sends where a board is, in its own frame, at 30 Hz: late, with jitter, noise and losses.

    :ivar hidden: nothing is sent
    """

    def __init__(self, running, board, quality, twist=(0.0, SPEED, 0.0)):
        self._board, self._twist, self._clock = board, np.array(twist), running.client.clock
        self._begins, self.hidden = self._clock.wall(), False
        self._publisher = running.participant.publisher(TFMessage, '/tf', quality)
        running._made.append(self._publisher)
        static_broadcaster(running, transform(FRAME, 'camera', CAMERA, messages.stamp_of(
            self._begins)))
        self.running = self._clock.start(self._send())

    def where(self, stamp):
        """Pose of the board at a time [ns]."""
        result = self._board.copy()
        result[:3] += self._twist * (stamp - self._begins) / NS
        return result

    def _send(self):
        choose, clock = random.Random(1), self._clock
        while True:
            yield clock.now() + PERIOD_NS
            stamp = clock.wall() - round((LATENCY_S + 0.01 * choose.random()) * NS)
            if not self.hidden and choose.random() > 0.05:
                seen = compose(inverse(CAMERA), self.where(stamp))
                seen[:3] += [choose.gauss(0.0, 0.5e-3) for _ in range(3)]
                message = TransformStamped(child_frame_id='board')
                message.header.frame_id, message.header.stamp = 'camera', messages.stamp_of(stamp)
                messages.set_transform(message.transform, seen)
                self._publisher.publish(TFMessage(transforms=[message]))


@pytest.fixture
def among(running, skill_file, tmp_path):
    """Skill file of the letter, which ends at a board."""
    letter = Skill.load(skill_file)
    path = letter.reproduce(0.02)
    Skill.learn(Demonstration(path.times, path.points, letter.manifold, frames={
        'start': letter.start[:7], 'board': letter.goal[:7]}), start_frame='start',
        goal_frame='board').save(tmp_path / 'among.json')
    assert running.set_parameters(SERVER, moving_objects=['board'], object_age=0.5).successful
    return tmp_path / 'among.json'


@pytest.mark.parametrize('quality', [best_effort(10), reliable(10)],
                         ids=['best effort', 'reliable'])
def test_the_arm_meets_a_board_that_moves(running, among, quality):
    goal = Skill.load(among).goal[:7]
    camera = Camera(running, goal - [0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0], quality)
    running.spend(0.3)
    running.client.execute(ExecuteSkill.Goal(skill=str(among)))
    result = running.client.result(60.0)
    assert (result.error_code, result.error_string) == (result.SUCCESSFUL, '')
    running.listen()
    running.spend(0.5)
    stamps = np.array([m.header.stamp.sec * NS + m.header.stamp.nanosec
                       for m in running.references])
    shown = np.array([messages.pose_numbers(m.pose) for m in running.references])
    boards = np.array([camera.where(stamp) for stamp in stamps])
    assert np.linalg.norm(shown[:, :3] - boards[:, :3], axis=1).max() < 2e-3
    assert running.state.status == 'moving'  # it stays with the board
    # The board is not seen any more: its frame rests, and the motion ends there.
    camera.hidden = True
    running.wait('the end', lambda: running.state.status == 'holding')
    assert 'object board: no pose that can be used for' in running.state.last_refusal
    camera.running.end()


def test_a_board_that_is_known_too_late_is_refused(running, among):
    goal = Skill.load(among).goal[:7]
    camera = Camera(running, goal, reliable(10), (0.0, 0.0, 0.0))
    running.spend(0.3)
    camera.hidden = True
    running.spend(2.0)
    running.client.execute(ExecuteSkill.Goal(skill=str(among)))
    result = running.client.result(10.0)
    assert result.error_code == result.INVALID_GOAL
    assert 'object board: its newest pose is' in result.error_string
    assert 'expected at most 0.5 s (object_age)' in result.error_string
    camera.running.end()

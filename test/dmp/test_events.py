"""Commands for a gripper as part of a skill."""
import numpy as np
import pytest

from gdmp_ros.control.gripper import DEFAULT_SPEED
from gdmp_ros.data.recordings import common_events, during, RecordedCommand
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.manifolds import Euclidean

CLOSE, OPEN = GripperEvent(0.4, 0.0, 20.0, 0.1), GripperEvent(1.0, 0.08, 0.0, 0.1)


def shown(warp=0.0, seconds=3.0):
    """A bent stroke; with a warp its first half is quicker."""
    t = np.linspace(0.0, 1.0, 301)
    s = t + warp * np.sin(np.pi * t) ** 2
    share = s ** 3 * (10.0 - 15.0 * s + 6.0 * s ** 2)
    points = np.column_stack([share, 0.4 * np.sin(np.pi * share), 0.2 * share ** 2])
    return Demonstration(seconds * t, points, Euclidean(3))


def progress_where(take, x):
    """Progress at which a take passes a place."""
    at = int(np.argmax(take.points[:, 0] >= x))
    return float(take.times[at] / take.duration)


def test_events_are_saved_with_the_skill(tmp_path):
    skill = Skill.learn(shown()).with_events([CLOSE, OPEN])
    skill.save(tmp_path / 'skill.json')
    assert Skill.load(tmp_path / 'skill.json').events == (CLOSE, OPEN)
    assert Skill.learn(shown()).events == ()


@pytest.mark.parametrize(('events', 'reason'), [
    ([OPEN, CLOSE], 'before that of the event before'), ([CLOSE._replace(progress=1.2)], '0 to 1'),
    ([CLOSE._replace(width=float('nan'))], 'finite'), ([CLOSE._replace(speed=0.0)], 'speed')])
def test_events_that_are_not_possible_are_refused(events, reason):
    with pytest.raises(ParameterError, match=reason):
        Skill.learn(shown()).with_events(events)


def test_commands_before_and_after_the_motion_count_at_its_ends():
    commands = [RecordedCommand(stamp, width, 0.0, DEFAULT_SPEED)
                for stamp, width in ((0, 0.05), (50, 0.08), (150, 0.0), (900, 0.08))]
    events = during(commands, 100, 200)
    assert [(e.progress, e.width) for e in events] == [(0.0, 0.08), (0.5, 0.0), (1.0, 0.08)]


def test_several_takes_act_at_the_same_place_of_the_motion():
    """The takes differ in timing: the mean of the times would be at another place."""
    takes = [shown(0.0), shown(0.12, 2.5), shown(-0.12, 4.0)]
    events = [(CLOSE._replace(progress=progress_where(take, 0.5)),) for take in takes]
    (found,) = common_events(takes, ['a', 'b', 'c'], events)
    skill = Skill.learn(takes)
    place = skill.rollout().sample(np.array([found.progress * skill.duration])).points[0]
    assert place[0] == pytest.approx(0.5, abs=0.03)
    assert found.force == 20.0


def test_takes_with_other_commands_are_refused():
    with pytest.raises(DataError, match='second: the gripper was told to hold, in first to hold, '
                                        'to move'):
        common_events([shown(), shown()], ['first', 'second'], [(CLOSE, OPEN), (CLOSE,)])

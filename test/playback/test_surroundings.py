"""What has moved since a motion began, and is bent around."""
import numpy as np
import pytest

from gdmp_ros.learning.detour import BlockedError
from gdmp_ros.playback.surroundings import Surroundings
from gdmp_ros.scene import Scene, Volume
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.tool_shape import tool_of
from test.learning.test_detour import GOAL, line, START


def box(name, place, size, **others):
    return Volume(name, 'box', size, np.array([*place, 1.0, 0.0, 0.0, 0.0]), **others)


def moved_to(before, after):
    """Names of what has moved, when a motion began among volumes, and there are others then."""
    surroundings = Surroundings(tool_of(Arm()))
    surroundings.scene = Scene(before)
    surroundings.begin(surroundings.led(line(START, GOAL, np.zeros(3)), None, None))
    surroundings.scene = Scene(after)
    return surroundings.moved.names


def test_what_has_come_or_moved_is_bent_around_unless_the_tool_may_touch_it():
    here, there = box('crate', (0.8, 0.5, 0.1), (0.1, 0.1, 0.1)), (0.8, 0.4, 0.1)
    assert moved_to([here], [here]) == ()
    assert moved_to([here], [box('crate', there, (0.1, 0.1, 0.1))]) == ('crate',)
    assert moved_to([], [here]) == ('crate',)
    assert moved_to([here], [box('crate', there, (0.1, 0.1, 0.1), allowed=('hand',))]) == ()


def test_parts_that_are_cut_in_another_way_have_not_moved():
    whole = box('cloud#1', (0.8, 0.4, 0.05), (0.4, 0.4, 0.1))
    halves = [box('cloud#1', (0.7, 0.4, 0.05), (0.2, 0.4, 0.1)),
              box('cloud#2', (0.9, 0.4, 0.05), (0.2, 0.4, 0.1))]
    assert moved_to([whole], halves) == () and moved_to(halves, [whole]) == ()
    comes = box('cloud#3', (0.4, 0.5, 0.1), (0.1, 0.1, 0.2))
    assert moved_to([whole], [*halves, comes]) == ('cloud#3',)


def test_a_motion_that_is_refused_changes_nothing_for_the_one_that_runs():
    surroundings = Surroundings(tool_of(Arm()))
    surroundings.begin(surroundings.led(line(START, GOAL, np.zeros(3)), None, None))
    surroundings.scene = Scene([box('crate', GOAL, (0.2, 0.2, 0.2))])
    with pytest.raises(BlockedError):
        surroundings.led(line(START, GOAL, np.zeros(3)), None, None)
    assert surroundings.moved.names == ('crate',)

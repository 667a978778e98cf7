"""No kernel of a tick asks the system for memory: that takes an unknown time."""
from contextlib import contextmanager

from numba.core.runtime import rtsys
from numba.core.runtime.nrt import _nrt
import numpy as np
import pytest

from gdmp_ros.control import stream
from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.joint_target import resting_joints
from gdmp_ros.control.law import compute
from gdmp_ros.control.memory import FREE, JOINT_MOTION, JOINT_SPRINGS, TOOL_SPRING
from gdmp_ros.control.plain_tick import controller_of
from gdmp_ros.control.target import resting_target, STIFFNESS, TWIST, WRENCH_GAIN
from gdmp_ros.kernels import allocating, kernel, local_matrix, local_numbers, local_zeros
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.plain_tick import follow_plainly, robot_of


@kernel
def ticks(numbers, count):
    for _ in range(count):
        compute(numbers)


@kernel
def references(numbers, last, joints, held, target, count):
    for k in range(count):
        stream.go_on(numbers, last, held, target, 0.001, 0.0, k + 2.0, 0.0)
        stream.elapse(numbers, 0.001)
        stream.advance(numbers, last, joints, 0.001)
    return numbers[0]


@allocating
def with_memory(count):
    total = 0.0
    for _ in range(count):
        total += np.ones(6).sum()
    return total


@contextmanager
def counted():
    """How many times memory is allocated meanwhile; a call from Python does so for its arrays."""
    _nrt.memsys_enable_stats()
    result = []
    before = rtsys.get_allocation_stats().alloc
    try:
        yield result
        result.append(rtsys.get_allocation_stats().alloc - before)
    finally:
        _nrt.memsys_disable_stats()


def loop_that(does):
    """An arm that moves, pushed and with a changing stiffness, in a kind of tick."""
    loop = ClosedLoop(Arm())
    target = resting_target(loop.arm.measure().pose)
    target[TWIST + 1], target[WRENCH_GAIN + 2] = 0.04, 1.0
    target[STIFFNESS] = 900.0
    if does == JOINT_SPRINGS:
        position = loop.arm.measure().position
        target = resting_joints(position + 0.01, np.full(len(position), 150.0))
    loop.must_follow(target)
    loop.arm.push(np.array([3.0, -5.0, 2.0, 0.1, 0.2, 0.3]))
    for _ in range(5):
        loop.tick()
    loop.controller.memory.scalars.does = does
    return loop


@pytest.mark.parametrize('does', [TOOL_SPRING, JOINT_SPRINGS, FREE, JOINT_MOTION])
def test_the_law_does_not_allocate(does):
    numbers = loop_that(does).controller.numbers
    ticks(numbers, 1)
    with counted() as once:
        ticks(numbers, 1)
    with counted() as often:
        ticks(numbers, 1000)
    assert often == once


def test_a_stream_that_goes_on_does_not_allocate():
    loop = loop_that(TOOL_SPRING)
    guard, target = loop.controller.guard, loop.controller.guard.targets[0].copy()
    loop.states.take(Request.MOTION)
    arguments = guard.numbers, *guard.targets, guard.held, target
    references(*arguments, 1)
    with counted() as once:
        references(*arguments, 1)
    with counted() as often:
        references(*arguments, 1000)
    assert often == once


def test_the_ticks_of_a_simulated_arm_do_not_allocate():
    loop = loop_that(TOOL_SPRING)
    target = loop.controller.guard.targets[0].copy()
    arguments = robot_of(loop.driver), controller_of(loop), loop.driver.dt

    def follow(count):
        references, poses = np.tile(target, (count, 1)), np.empty((count, 7))
        with counted() as result:
            made, _ = follow_plainly(*arguments, references, poses)
        assert made == count
        return result
    follow(1)
    assert follow(100_000) == follow(1)


def test_memory_that_is_allocated_is_counted():
    with_memory(1)
    with counted() as often:
        with_memory(1000)
    assert often[0] >= 1000


@kernel
def sums(count, numbers):
    total = 0.0
    for _ in range(count):
        total += _sum(numbers)
    return total


@kernel
def _sum(numbers):
    n = numbers.size
    row, table, total = local_zeros(n), local_matrix(n, 3), local_numbers(2)
    for i in range(n):
        for j in range(3):
            table[i, j] = (j + 1) * numbers[i]
        row[i] += table[i].sum()
    total[0], total[1] = row.sum(), 1.0
    return total[0] * total[1]


def test_numbers_on_the_stack_are_those_of_one_call():
    numbers = np.arange(7.0)
    # The stack would be full after 10 000 of a million calls, if it were not given back.
    assert sums(1_000_000, numbers) == 1_000_000 * 6.0 * numbers.sum()
    assert sums.py_func(3, numbers) == 18.0 * numbers.sum()

"""The memory of the compiled tick: its parts lie one after another."""
import numpy as np
import pytest

from gdmp_ros.control import memory
from gdmp_ros.kernels.intrinsics import Record


@pytest.mark.parametrize('joints', [1, 6, 7])
def test_the_parts_fill_the_memory_and_do_not_overlap(joints):
    numbers = memory.blank(joints, 5, 3)
    arm = memory.parts(numbers)
    parts = [part.numbers if isinstance(part, Record) else part for part in arm]
    for k, part in enumerate(parts, 1):
        part[:] = k
    for k, part in enumerate(parts, 1):
        assert part.size > 0 and np.all(part == k), memory.ArmMemory._fields[k - 1]
    assert np.all(numbers[len(memory.SIZES.names):] > 0.0)
    assert arm.sent.shape == (memory.MOST_TORQUES, joints) and arm.torque.shape == (joints,)

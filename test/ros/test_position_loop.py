"""Ticks of an arm that takes joint positions come when the arm has said something."""
import numpy as np
import pytest

from gdmp_ros.realtime.native import DEADLINE, PERIOD, STAMP
from gdmp_ros.ros.arm.compiled_loop import NUMBERS
from gdmp_ros.ros.arm.position_loop import keep_phase, PHASE

PERIOD_NS = 2_000_000


@pytest.mark.parametrize('every', [1, 4], ids=['each cycle', 'each fourth cycle'])
@pytest.mark.parametrize('ratio', [0.9998, 1.0003], ids=['faster', 'slower'])
def test_ticks_follow_the_clock_of_the_arm(rng, ratio, every):
    loop = np.zeros(NUMBERS, dtype=np.int64)
    loop[PERIOD], loop[DEADLINE] = PERIOD_NS, 10 * PERIOD_NS
    phases, begins = [], rng.uniform(0.0, PERIOD_NS)
    cycle = every * ratio * PERIOD_NS
    for _ in range(3000):
        loop[DEADLINE] += PERIOD_NS
        loop[STAMP] = loop[DEADLINE]
        # The newest message, with jitter of 0.1 ms.
        arrived = begins + cycle * ((loop[STAMP] - begins) // cycle)
        before = loop[DEADLINE]
        keep_phase(loop, int(arrived + rng.normal(0.0, 1e5)))
        assert abs(loop[DEADLINE] - before) <= 0.01 * PERIOD_NS
        phases.append(((loop[STAMP] - arrived) % PERIOD_NS) / PERIOD_NS)
    assert np.abs(np.array(phases[1000:]) - PHASE).max() < 0.1


def test_they_stay_where_they_are_while_the_arm_says_nothing():
    """Its last message grows old; then the arm is stopped anyway."""
    loop = np.zeros(NUMBERS, dtype=np.int64)
    loop[PERIOD], loop[DEADLINE] = PERIOD_NS, 10 * PERIOD_NS
    for _ in range(500):
        loop[DEADLINE] += PERIOD_NS
        loop[STAMP] = loop[DEADLINE]
        keep_phase(loop, 9 * PERIOD_NS)
    phase = ((loop[STAMP] - 9 * PERIOD_NS) % PERIOD_NS) / PERIOD_NS
    assert phase == pytest.approx(PHASE, abs=0.02)

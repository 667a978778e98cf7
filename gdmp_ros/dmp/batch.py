"""Many roll-outs stepped in one call: different skills, manifolds, phases and goals."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp.integrator import advance
from gdmp_ros.dmp.options import check_steps
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.state import State
from gdmp_ros.errors import ParameterError


class Batch:
    """
    Roll-outs that share a memory.

    `Rollout.retarget`, `set_speed`, `flags` and even its own `advance` act on each of them as
    before. A roll-out belongs to one batch at most. Not to be shared between threads; the step
    itself does not hold the interpreter lock.
    """

    def __init__(self, rollouts: Sequence[Rollout]):
        """
        Join roll-outs.

        :raises ParameterError: without any, or if one is in a batch already
        """
        self.rollouts = tuple(rollouts)
        if not self.rollouts:
            raise ParameterError('a batch needs at least one roll-out, got none')
        if (len({id(one) for one in self.rollouts}) < len(self.rollouts)
                or any(one.memory.base is not None for one in self.rollouts)):
            raise ParameterError('a roll-out can be in one batch only, and only once')
        sizes = [one.memory.size for one in self.rollouts]
        self._memory = np.concatenate([one.memory for one in self.rollouts])
        for one, end, size in zip(self.rollouts, np.cumsum(sizes), sizes):
            one.use_memory(self._memory[end - size:end])
        states = np.array([one.state_size for one in self.rollouts])
        ends = np.cumsum(states)
        self._parts = [slice(end - size, end) for end, size in zip(ends, states)]
        self._times = ends - states
        self._size = int(states.sum())

    def advance(self, dt: float | np.ndarray) -> list[State]:
        """
        Let time pass for all of them and return their states then.

        :param dt: as in `Rollout.advance`; one for all, or one for each, shape
            ``(len(rollouts),)``
        :raises ParameterError: as `Rollout.advance`
        """
        check_steps(np.min(dt), np.max(dt))
        out = np.empty(self._size)
        out[self._times] = dt
        advance(self._memory, out)
        return [State(out[part], one.skill.manifold)
                for part, one in zip(self._parts, self.rollouts)]

"""Many roll-outs stepped in one call: different skills, manifolds, phases and goals."""
from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gdmp_ros.dmp import stepping
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.state import State
from gdmp_ros.errors import ParameterError


class Batch:
    """
    Roll-outs that share a memory.

    Each stays what it is: `Rollout.retarget`, `set_speed`, `flags` and even its own `advance` act
    on it as before. A roll-out belongs to one batch at most. Not to be shared between threads; the
    step itself holds no lock of the interpreter.
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
                or any(one._memory.base is not None for one in self.rollouts)):
            raise ParameterError('a roll-out can be in one batch only, and only once')
        sizes = [one._memory.size for one in self.rollouts]
        self._memory = np.concatenate([one._memory for one in self.rollouts])
        ends = np.cumsum(sizes)
        for one, end, size in zip(self.rollouts, ends, sizes):
            one._adopt(self._memory[end - size:end])
        outs = np.array([one._out_size for one in self.rollouts])
        self._cuts = [slice(end - size, end) for end, size in zip(np.cumsum(outs), outs)]
        self._times = np.cumsum(outs) - outs
        self._size = int(outs.sum())

    def advance(self, dt: float | np.ndarray) -> list[State]:
        """
        Let time pass for all of them and return their states then.

        :param dt: 0 or more [s]; one for all, or one for each, shape ``(len(rollouts),)``
        """
        out = np.empty(self._size)
        out[self._times] = dt
        stepping.advance(self._memory, out)
        return [State.of(out[cut], one.skill.manifold)
                for cut, one in zip(self._cuts, self.rollouts)]

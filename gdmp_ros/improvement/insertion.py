"""A task in simulation: a peg goes into a hole that is not exactly where it is believed to be."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.improvement.task import Scored, SimulatedTask
from gdmp_ros.improvement.trial import Trial
from gdmp_ros.improvement.variables import Spiral, Stiffness, Variable, Weights
from gdmp_ros.manifolds.poses import tool_manifold
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.scenes import HOLE_TOP, peg_and_hole, PEG_BELOW, PEG_HALF_LENGTH
from gdmp_ros.util.profiles import minimum_jerk

#: Where the hole is believed to be [m], and how far it is off at most [m].
PLACE, OFF = np.array([0.45, 0.0]), 0.003
#: Clearance on each side of the peg [m]; how deep the peg is to go [m]: less was not inserted.
CLEARANCE, DEPTH, INSERTED = 0.0005, 0.025, 0.02
#: Height of the peg above the hole at the start [m], duration [s], stiffness along the axes.
ABOVE, DURATION, STIFFNESS = 0.01, 6.0, (1200.0, 1200.0, 400.0, 40.0, 40.0, 40.0)
#: Between peg and hole, as of metal that is not greased.
FRICTION = 0.3
#: Force that costs nothing [N], and the cost of a newton more.
FREE_FORCE, FORCE_COST = 40.0, 0.0005
_SAMPLES = 200
#: Of the search: two turns are less than twice the clearance apart, slow enough to fall in.
TURNS, N_BASIS = 6, 45


@dataclass
class Insertion(SimulatedTask):
    """The hole is off by up to 3 mm in any direction; the arm does not know it."""

    name: str = 'insertion'
    largest_force: float = 100.0

    def skill(self) -> Skill:
        """Straight down into the hole where it is believed to be."""
        s = np.linspace(0.0, 1.0, _SAMPLES)
        top = HOLE_TOP + PEG_BELOW + PEG_HALF_LENGTH
        stiffness = np.diag(STIFFNESS).reshape(-1)
        points = np.tile([*PLACE, top + ABOVE, 0.0, 1.0, 0.0, 0.0, *stiffness], (_SAMPLES, 1))
        points[:, 2] -= (ABOVE + DEPTH) * minimum_jerk(s)
        return Skill.learn(Demonstration(DURATION * s, points, tool_manifold(6)), N_BASIS,
                           provenance={'shown': 'straight down'})

    def variables(self) -> Sequence[Variable]:
        """A spiral across the hole, the height, and stiffness along, across and for turns."""
        return [Spiral(TURNS, OFF), Weights(4, {'position': 0.003}, (2,)),
                Stiffness(1, 0.5, ((0, 1), (2,), (3, 4, 5)))]

    def off(self, seed: int) -> np.ndarray:
        """How far the hole is off [m], evenly distributed in a disk."""
        rng = np.random.default_rng(seed)
        offset, direction = OFF * np.sqrt(rng.random()), 2.0 * np.pi * rng.random()
        return np.array([offset * np.cos(direction), offset * np.sin(direction)])

    def arm(self, seed: int) -> Arm:
        """Arm, with what is around it; the built-in Panda alone by default."""
        x, y = PLACE + self.off(seed)
        return Arm(peg_and_hole((float(x), float(y)), 0.0, CLEARANCE, FRICTION))

    def score(self, trial: Trial) -> Scored:
        """Score by how deep the peg is at the end, and how hard it was pressed."""
        depth = HOLE_TOP - (trial.measured[-1, 2] - PEG_BELOW - PEG_HALF_LENGTH)
        force = float(np.linalg.norm(trial.wrenches[:, :3], axis=1).max())
        return Scored({'depth': 1.0 - depth / DEPTH,
                       'force': FORCE_COST * max(force - FREE_FORCE, 0.0)},
                      bool(depth > INSERTED))

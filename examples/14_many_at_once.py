"""Advance many roll-outs in one compiled call, for example for several robots."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Batch, Rollout, Skill
from gdmp_ros.data import lasa

skill, rng = Skill.learn(lasa.robot_demonstrations('WShape')[0]), np.random.default_rng(0)
rollouts = []
for _ in range(30):
    goal = skill.goal.copy()
    goal[:2] += rng.normal(0.0, 0.03, 2)
    rollouts.append(Rollout(skill, goal=goal))
batch, paths = Batch(rollouts), []
for _ in range(round(1.2 * skill.duration / 0.01)):
    paths.append([state.point[:2].copy() for state in batch.advance(0.01)])

for path in np.array(paths).transpose(1, 0, 2):
    plt.plot(*path.T, lw=0.8)
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal', title='30 goals')
plt.savefig('14_many_at_once.png')

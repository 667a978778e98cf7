"""Learn from several takes: how they vary is part of the skill."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Skill
from gdmp_ros.data import lasa

plt.figure(layout='constrained')
takes = lasa.robot_demonstrations('JShape')
skill = Skill.learn(takes, 30)
rng = np.random.default_rng(0)

for take in takes:
    plt.plot(*take.points[:, :2].T, color='0.6', lw=1)
for number in range(15):
    drawn = skill.distribution.sample(rng).reproduce(0.02)
    plt.plot(*drawn.points[:, :2].T, color='C1', lw=0.6, label='drawn' if number == 0 else None)
plt.plot(*skill.reproduce(0.01).points[:, :2].T, color='C0', lw=2, label='skill')
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('05_several_takes.png')

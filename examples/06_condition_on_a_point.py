"""Ask for the most likely motion through a point: it varies as the takes did."""
from matplotlib import pyplot as plt

from gdmp_ros import Skill
from gdmp_ros.data import lasa

plt.figure(layout='constrained')
takes = lasa.robot_demonstrations('CShape')
skill = Skill.learn(takes, 30)
point = skill.distribution.mean(0.5).copy()
point[1] += 0.02
passing = skill.distribution.condition([(0.5, point)])

for take in takes:
    plt.plot(*take.points[:, :2].T, color='0.75', lw=1)
plt.plot(*skill.reproduce(0.01).points[:, :2].T, label='skill')
plt.plot(*passing.reproduce(0.01).points[:, :2].T, label='most likely through the point')
plt.plot(*point[:2], 'k*', label='point at s = 0.5')
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('06_condition_on_a_point.png')

"""Bend a motion around a point; the goal is reached all the same."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Rollout, Skill
from gdmp_ros.data import lasa

plt.figure(layout='constrained')
skill = Skill.learn(lasa.robot_demonstrations('Line')[0])
obstacle = skill.rollout(duration=1.0).sample([0.5]).points[0][:3] + [0.002, 0.0, 0.0]
rollout, path = Rollout(skill), []
rollout.set_obstacles(obstacle[None], gain=2e4, reach=0.2, bound=50.0)
while not rollout.finished:
    path.append(rollout.advance(0.005).point[:3].copy())

plt.plot(*skill.reproduce(0.01).points[:, :2].T, '--', color='0.6', label='learned')
plt.plot(*np.array(path)[:, :2].T, label='around the point')
plt.plot(*obstacle[:2], 'ko', label='obstacle')
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('11_avoid_a_point.png')

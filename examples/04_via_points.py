"""Let a skill pass through points that no demonstration showed."""
from matplotlib import pyplot as plt

from gdmp_ros import Skill
from gdmp_ros.data import lasa

plt.figure(layout='constrained')
skill = Skill.learn(lasa.robot_demonstrations('Spoon')[0])
via = skill.rollout(duration=1.0).sample([0.3, 0.7]).points.copy()
via[0, :3] += [0.0, 0.02, 0.0]
via[1, :3] += [0.02, 0.0, 0.0]
bent = skill.through([(0.3, via[0]), (0.7, via[1])], factors=['position'])

for one, label in ((skill, 'learned'), (bent, 'through two via points')):
    plt.plot(*one.reproduce(0.01).points[:, :2].T, label=label)
plt.plot(*via[:, :2].T, 'k*', label='via points')
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('04_via_points.png')

"""Learn a handwritten letter, and compare the motion with the demonstration."""
from matplotlib import pyplot as plt

from gdmp_ros import fit_report, Skill
from gdmp_ros.data import lasa

plt.figure(layout='constrained')
shown = lasa.robot_demonstrations('GShape')[0]
skill = Skill.learn(shown)
print(fit_report(skill, shown))

motion = skill.reproduce(0.01)
plt.plot(*shown.points[:, :2].T, color='0.7', lw=4, label='demonstration')
plt.plot(*motion.points[:, :2].T, color='C0', label=f'skill, {skill.n_basis} functions')
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('01_learn_a_letter.png')

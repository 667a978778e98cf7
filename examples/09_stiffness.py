"""Stiffness from the takes: high where they agree, low where they vary."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros.data import lasa
from gdmp_ros.learning import stiffness_from_takes

plt.figure(layout='constrained')
takes = lasa.robot_demonstrations('PShape')
s, stiffness = stiffness_from_takes(takes, 200.0, 800.0)
values = np.linalg.eigvalsh(stiffness)

for number, name in enumerate(('softest', 'middle', 'stiffest')):
    plt.plot(s, values[:, number], label=f'{name} direction')
plt.gca().set(xlabel='progress [1]', ylabel='stiffness [N/m]', ylim=(0.0, None))
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('09_stiffness.png')

"""Write roll-outs of a skill as a LeRobot data set, and read them again."""
from pathlib import Path
import shutil

from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Skill
from gdmp_ros.data import episodes, foreign, lasa, lerobot

plt.figure(layout='constrained')
skill = Skill.learn(lasa.robot_demonstrations('GShape'), 30)
rng = np.random.default_rng(0)
motions = [foreign.motion(skill.distribution.sample(rng), 0.01) for _ in range(10)]
folder = Path('15_letters')
shutil.rmtree(folder, ignore_errors=True)
lerobot.write(folder, motions, rate_hz=30, task='write a G')

for source in episodes.sources(folder):
    shown = episodes.read(source).demonstration
    plt.plot(*shown.points[:, :2].T, lw=1, label=source.name)
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=5, fontsize=6)
plt.savefig('15_a_data_set_for_a_policy.png')

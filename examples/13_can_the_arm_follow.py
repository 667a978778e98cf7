"""Ask before running: can the arm follow the path, and how near does it come to its limits?"""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Skill
from gdmp_ros.data import lasa
from gdmp_ros.sim import Arm
from gdmp_ros.sim.path_check import PathChecker

skill = Skill.learn(lasa.robot_demonstrations('GShape')[0])
times = np.linspace(0.0, skill.duration, 100)
figure, axes = plt.subplots(figsize=(6, 4), layout='constrained')
for away in (0.0, 0.1, 0.18):
    poses = skill.rollout().sample(times).points[:, :7].copy()
    poses[:, 0] += away
    found = PathChecker(Arm()).check(times, poses)
    print(f'{away:g} m further away:', '; '.join(found.problems()) or 'it can')
    axes.plot(times, found.singular, label=f'{away:g} m further away')
axes.axhline(found.margins[1].least, color='0.5', ls='--', label='limit')
axes.set(xlabel='time [s]', ylabel='smallest singular value [m]')
figure.legend(loc='outside upper center', ncols=3)
figure.savefig('13_can_the_arm_follow.png')

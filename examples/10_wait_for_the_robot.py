"""Phase stopping: a robot that is held back does not lose its path."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Rollout, Skill
from gdmp_ros.data import lasa

plt.figure(layout='constrained')
skill = Skill.learn(lasa.robot_demonstrations('Line')[0])
rows = []
for kappa in (0.0, 50.0):
    rollout = Rollout(skill, phase_stopping=kappa, error_weights=[400.0, 4.0, 0.0])
    robot = skill.start.copy()
    for tick in range(900):
        state = rollout.advance(0.01)
        held = 1.0 < 0.01 * tick < 3.0
        if not held:  # a robot that follows with a lag
            robot[:3] += 0.2 * (state.point[:3] - robot[:3])
        rollout.observe(robot)
        rows.append([kappa, 0.01 * tick, np.linalg.norm(state.point[:3] - robot[:3])])
rows = np.array(rows)
for kappa in (0.0, 50.0):
    part = rows[rows[:, 0] == kappa]
    plt.plot(part[:, 1], 1e3 * part[:, 2], label=f'kappa = {kappa:g}')
plt.axvspan(1.0, 3.0, color='0.9', label='held back')
plt.gca().set(xlabel='time [s]', ylabel='distance from the reference [mm]')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('10_wait_for_the_robot.png')

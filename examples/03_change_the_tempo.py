"""Slow a motion down and stop it on its path; the path does not change."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Rollout, Skill
from gdmp_ros.data import lasa

skill = Skill.learn(lasa.robot_demonstrations('Sine')[0])
rollout, rows = Rollout(skill), []
for tick in range(1200):
    time = 0.01 * tick
    if time in (1.0, 2.0, 4.0):
        rollout.set_speed({1.0: 0.3, 2.0: 0.0, 4.0: 1.0}[time])
    state = rollout.advance(0.01)
    rows.append([time, rollout.speed, *state.point[:2]])
times, speed, x, y = np.array(rows).T

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout='constrained')
left.plot(times, speed)
left.set(xlabel='time [s]', ylabel='tempo [1]')
right.plot(*skill.reproduce(0.01).points[:, :2].T, color='0.7', lw=4, label='tempo 1')
right.plot(x, y, label='with changes of the tempo')
right.set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
figure.legend(loc='outside upper center', ncols=3)
figure.savefig('03_change_the_tempo.png')

"""Switch the goal while the motion is being made: velocity and acceleration have no step."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Rollout, Skill
from gdmp_ros.data import lasa

skill = Skill.learn(lasa.robot_demonstrations('Angle')[0])
rollout, path, speed = Rollout(skill), [], []
goal = skill.goal.copy()
goal[:3] += [0.05, 0.08, 0.0]
while not rollout.finished:
    if abs(rollout.progress - 0.5) < 1e-3:
        rollout.retarget(goal)
    state = rollout.advance(0.005)
    path.append(state.point[:2].copy())
    speed.append((state.time, np.linalg.norm(state.velocity[:3])))

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout='constrained')
left.plot(*skill.reproduce(0.01).points[:, :2].T, '--', color='0.6', label='without the switch')
left.plot(*np.array(path).T, label='with the switch')
left.plot(*goal[:2], 'k*', label='new goal')
left.set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
figure.legend(loc='outside upper center', ncols=3)
right.plot(*np.array(speed).T)
right.set(xlabel='time [s]', ylabel='speed [m/s]')
figure.savefig('02_switch_the_goal.png')

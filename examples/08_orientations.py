"""Orientations as unit quaternions: a goal switch turns the tool smoothly."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Demonstration, Rollout, Skill, UnitQuaternion

plt.figure(layout='constrained')
times = np.linspace(0.0, 2.0, 200)
angle = 0.4 * (1.0 - np.cos(np.pi * times / 2.0))
shown = np.column_stack([np.cos(angle), np.sin(angle), 0.0 * angle, 0.0 * angle])
skill = Skill.learn(Demonstration(times, shown, UnitQuaternion()))

rollout, rows = Rollout(skill), []
while not rollout.finished:
    if 0.8 < rollout.state.time < 0.805:
        rollout.retarget(np.array([0.6, 0.0, 0.8, 0.0]))
    state = rollout.advance(0.005)
    rows.append([state.time, *state.point])
rows = np.array(rows)
for number, name in enumerate(('w', 'x', 'y', 'z'), 1):
    plt.plot(rows[:, 0], rows[:, number], label=name)
plt.axvline(0.8, color='0.6', ls='--', label='goal switched')
plt.gca().set(xlabel='time [s]', ylabel='quaternion [1]')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('08_orientations.png')

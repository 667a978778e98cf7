"""Learn a cycle from a noisy recording; change its amplitude, frequency and centre."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Demonstration, Euclidean, Rollout, Skill

plt.figure(figsize=(6.4, 3.0), layout='constrained')
times = np.arange(0.0, 12.0, 0.01)
angle = 2.0 * np.pi * times / 2.0
points = np.column_stack([0.10 * np.cos(angle), 0.04 * np.sin(2.0 * angle)])
points += 0.002 * np.random.default_rng(0).standard_normal(points.shape)
skill = Skill.learn_rhythmic(Demonstration(times, points, Euclidean(2)))
print(f'the period is {skill.duration:.3f} s')

rollout = Rollout(skill, start=np.array([-0.2, 0.0]))  # from rest, beside the cycle
path = [rollout.advance(0.01).point for _ in range(500)]
rollout.set_amplitude(0.5)
rollout.set_frequency(0.8)
rollout.retarget(skill.goal + [0.25, 0.0])
path += [rollout.advance(0.01).point for _ in range(500)]
rollout.set_amplitude(0.0)  # ends at the centre
while not rollout.finished:
    path.append(rollout.advance(0.01).point)

plt.plot(*points.T, '.', ms=1, color='0.7', label='recording')
plt.plot(*np.array(path).T, label='executed')
plt.plot(*path[0], 'ko', label='start')
plt.plot(*path[-1], 'k*', label='end')
plt.gca().set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=4)
plt.savefig('18_repeat_a_cycle.png')

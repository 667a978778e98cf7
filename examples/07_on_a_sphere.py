"""A skill on a sphere: its points stay on it, and the goal can be anywhere."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Demonstration, Rollout, Skill, Sphere

times = np.linspace(0.0, 2.0, 300)
turn, height = 0.8 * (1.0 - np.cos(np.pi * times / 2.0)), 0.3 * np.sin(np.pi * times)
points = np.column_stack([np.cos(turn) * np.cos(height), np.sin(turn) * np.cos(height),
                          np.sin(height)])
skill = Skill.learn(Demonstration(times, points, Sphere(2)))
moved = Rollout(skill, goal=np.array([0.0, 0.6, 0.8])).sample(np.linspace(0.0, 2.4, 300)).points

axes = plt.figure(figsize=(5, 5), layout='constrained').add_subplot(projection='3d')
u, v = np.meshgrid(np.linspace(0.0, np.pi, 20), np.linspace(0.0, np.pi, 20))
axes.plot_wireframe(np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v), color='0.9')
axes.plot(*points.T, color='0.5', lw=4, label='demonstration')
axes.plot(*skill.reproduce(0.01).points.T, label='skill')
axes.plot(*moved.T, label='another goal')
axes.set(xlabel='x [1]', ylabel='y [1]', zlabel='z [1]', aspect='equal')
plt.gcf().legend(loc='outside upper center', ncols=3)
plt.savefig('07_on_a_sphere.png')

"""A motion, taught once between two objects, is executed where they are, also when one moves."""
import matplotlib.pyplot as plt
import numpy as np

from gdmp_ros import Demonstration, Euclidean, Product, Rollout, Skill, UnitQuaternion
from gdmp_ros.manifolds.poses import compose

POSE = Product(Euclidean(3), UnitQuaternion(), names=('position', 'orientation'))
OVER_BOX = np.array([0.0, 0.0, 0.05, 0.0, 1.0, 0.0, 0.0])  # the tool, as seen from the box
AT_SHELF = np.array([-0.08, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0])


def turned(x, y, z, angle):
    """Pose of an object that stands, turned about the vertical."""
    return np.array([x, y, z, np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])


box, shelf = turned(0.4, -0.2, 0.1, 0.3), turned(0.5, 0.3, 0.3, 1.2)
times = np.linspace(0.0, 4.0, 200)
way = times / 4.0
way = way ** 3 * (10.0 - 15.0 * way + 6.0 * way ** 2)
begins, ends = compose(box, OVER_BOX), compose(shelf, AT_SHELF)
points = np.array([POSE.geodesic(begins, ends, share) for share in way])
points[:, :3] += np.sin(np.pi * way)[:, None] ** 2 * [0.15, 0.0, 0.1]
skill = Skill.learn(Demonstration(times, points, POSE, frames={'start': box, 'goal': shelf}))

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.0), layout='constrained')
left.plot(*points[:, :2].T, 'k', lw=3.0, alpha=0.4, label='shown')
for x, y, angle in ((0.5, 0.3, 2.2), (0.6, 0.35, 0.2), (0.35, 0.4, 1.2)):
    moved = turned(x, y, 0.3, angle)
    path = Rollout(skill, frames={'goal': moved}).sample(np.linspace(0.0, 5.0, 300)).points
    line, = left.plot(*path[:, :2].T, label=f'shelf turned by {angle:g} rad')
    left.arrow(x, y, 0.06 * np.cos(angle), 0.06 * np.sin(angle), width=0.006,
               color=line.get_color())
left.set(xlabel='x [m]', ylabel='y [m]', aspect='equal', title='Where the shelf is')
left.legend(fontsize=6, loc='lower right')

# The shelf is pushed away with 0.05 m/s, after it was moved by 0.1 m at once.
rollout, states, goals = Rollout(skill), [], []
for step in range(700):
    states.append(rollout.advance(0.01))
    if step == 150:
        rollout.move_frame('goal', turned(0.6, 0.3, 0.3, 1.2), [0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    goals.append(rollout.goal[:2])
time = [state.time for state in states]
right.plot(time, [state.point[:2] for state in states], label=['x', 'y'])
right.plot(time, goals, 'k:', lw=1.0)
right.set(xlabel='time [s]', ylabel='position, and the goal (dotted) [m]',
          title='A shelf that moves')
right.legend()
plt.savefig('20_where_the_objects_are.png')

"""Execute skills one after the other, without a step of the acceleration at the joins."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data import lasa
from gdmp_ros.dmp.sequence import HoldStep, MotionStep, SequenceRollout, SkillSequence

figure, (above, timed) = plt.subplots(2, layout='constrained')
letter = Skill.learn(lasa.robot_demonstrations('GShape')[0])
times = np.arange(0.0, 5.0, 0.01)
circles = np.tile(letter.goal, (len(times), 1))
circles[:, 0] += 0.03 * np.cos(2.0 * np.pi * times)
circles[:, 1] += 0.03 * np.sin(2.0 * np.pi * times)
wipe = Skill.learn_rhythmic(Demonstration(times, circles, letter.manifold))

rollout = SequenceRollout(SkillSequence([
    MotionStep('letter', letter, blend=0.5), MotionStep('wipe', wipe, cycles=3.0, blend=0.1),
    MotionStep('back', letter, goal=letter.start), HoldStep('wait', 0.5)]))
states, names = [], []
while not rollout.finished:
    names.append(rollout.course.step.name)
    states.append(rollout.advance(0.005))

time = np.array([state.time for state in states])
position = np.array([state.point[:2] for state in states])
speed = np.array([np.linalg.norm(state.velocity[:3]) for state in states])
for name in dict.fromkeys(names):
    part = np.array(names) == name
    above.plot(*position[part].T, label=name)
    timed.plot(time[part], speed[part])
above.set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
timed.set(xlabel='time [s]', ylabel='speed [m/s]')
figure.legend(loc='outside right upper')
plt.savefig('19_a_sequence.png')

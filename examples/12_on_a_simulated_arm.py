"""Execute a skill with the impedance controller of a simulated Panda."""
from matplotlib import pyplot as plt
import numpy as np

from gdmp_ros import Skill
from gdmp_ros.data import lasa
from gdmp_ros.sim import Arm
from gdmp_ros.sim.execution import execute

arm = Arm()
done = execute(Skill.learn(lasa.robot_demonstrations('GShape')[0]), arm)
error = 1e3 * np.linalg.norm(done.measured[:, :3] - done.references[:, :3], axis=1)

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout='constrained')
left.plot(*done.references[:, :2].T, color='0.7', lw=4, label='reference')
left.plot(*done.measured[:, :2].T, label='arm')
left.set(xlabel='x [m]', ylabel='y [m]', aspect='equal')
figure.legend(loc='outside upper center', ncols=3)
right.plot(arm.period * np.arange(len(error)), error)
right.set(xlabel='time [s]', ylabel='error [mm]')
figure.savefig('12_on_a_simulated_arm.png')

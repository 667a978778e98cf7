"""Writes `turns`, two episodes, with lerobot 0.4.4 (in an environment of its own)."""
import sys

from lerobot.datasets.lerobot_dataset import LeRobotDataset
import numpy as np

NAMES = ['x', 'y', 'z', 'qx', 'qy', 'qz', 'qw']
FEATURE = {'dtype': 'float32', 'shape': (7,), 'names': NAMES}


def main(folder):
    made = LeRobotDataset.create('gdmp/turns', fps=25, root=folder, robot_type='panda',
                                 features={'observation.state': FEATURE, 'action': FEATURE},
                                 use_videos=False)
    for episode in range(2):
        times = np.arange(40) / 25.0
        angle = 0.3 * (1.0 - np.cos(np.pi * times / times[-1])) * (1 + episode)
        zero = 0.0 * angle
        poses = np.column_stack([0.4 + 0.1 * angle, 0.1 * np.sin(angle), 0.3 + zero,
                                 np.sin(angle), zero, zero, np.cos(angle)]).astype(np.float32)
        for i in range(40):
            made.add_frame({'observation.state': poses[i], 'action': poses[min(i + 1, 39)],
                            'task': 'turn'})
        made.save_episode()
    made.finalize()


if __name__ == '__main__':
    main(sys.argv[1])

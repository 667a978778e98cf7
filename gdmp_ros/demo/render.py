"""Draws the arm at given joint positions with the path of its tool; a process of its own."""
from __future__ import annotations

import sys

import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.sim.panda import Arm
from gdmp_ros.sim.viewer import render


def main(numbers: str, picture: str) -> int:
    """
    Render.

    :param numbers: NumPy archive with ``joints`` [rad] and ``path`` [m]
    :param picture: PNG to write
    """
    from matplotlib.image import imsave
    with np.load(numbers) as given:
        arm = Arm()
        arm.reset(given['joints'])
        try:
            image = render(arm, given['path'])
        except DataError as error:
            print(error)
            return 1
    imsave(picture, image)
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))

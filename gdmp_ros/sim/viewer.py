"""Looking at a simulated arm: a window, or a picture without a screen."""
from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.sim.panda import Arm


class Viewer:
    """MuJoCo's own window beside a running simulation."""

    def __init__(self, arm: Arm):
        """:raises DataError: without a display"""
        import mujoco.viewer
        try:
            self._handle: Any = mujoco.viewer.launch_passive(arm.model, arm.data)
        except Exception as error:
            raise DataError(f'no viewer: {error}; use headless: true') from None

    def sync(self) -> None:
        """Show the present state."""
        if self._handle.is_running():
            self._handle.sync()

    def close(self) -> None:
        """Close the window."""
        self._handle.close()


def render(arm: Arm, path: np.ndarray | None = None, size: tuple[int, int] = (960, 720)
           ) -> np.ndarray:
    """
    Picture of the arm, shape ``(height, width, 3)`` uint8.

    :param path: positions to draw as a line of beads [m], shape ``(T, 3)``
    :raises DataError: without a way to render off screen; the message names the package to install
    """
    try:
        renderer = mujoco.Renderer(arm.model, size[1], size[0])
    except Exception as error:
        raise DataError('no off-screen rendering: install libegl1 (MUJOCO_GL=egl) or libosmesa6 '
                        f'(MUJOCO_GL=osmesa) [{type(error).__name__}]') from None
    try:
        renderer.update_scene(arm.data, camera='overview')
        for position in path if path is not None else ():
            _bead(renderer.scene, position)
        return np.asarray(renderer.render())
    finally:
        renderer.close()


def _bead(scene: Any, position: np.ndarray) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    mujoco.mjv_initGeom(scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_SPHERE,
                        np.array([0.004, 0.0, 0.0]), np.asarray(position, dtype=float),
                        np.eye(3).reshape(-1), np.array([0.85, 0.2, 0.15, 1.0], dtype=np.float32))
    scene.ngeom += 1

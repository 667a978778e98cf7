"""A window with a simulated arm, and off-screen pictures of it."""
from __future__ import annotations

import os
import sys
from typing import Any

import mujoco
import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.sim.arm import Arm


class NoScreenError(DataError):
    """Off-screen rendering is not possible on this machine."""


class Viewer:
    """MuJoCo's window beside a running simulation."""

    def __init__(self, arm: Arm):
        """:raises DataError: without a display"""
        # Without one, GLFW would end the process.
        display = os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')
        if sys.platform == 'linux' and not display:
            raise DataError('no viewer: there is no display (DISPLAY is not set); use '
                            'headless: true')
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


class Stage:
    """A model in a state to take pictures of."""

    def __init__(self, model: mujoco.MjModel):
        self.model, self.data = model, mujoco.MjData(model)

    @classmethod
    def of_arm(cls, name: str) -> Stage:
        """Stage of an arm (`gdmp_ros.sim.arm.Arm`)."""
        return cls(Arm(name).model)

    @classmethod
    def of_world(cls, path: str) -> Stage:
        """:raises DataError: if the file (MJCF, or a compiled model, .mjb) cannot be read"""
        try:
            return cls(mujoco.MjModel.from_binary_path(path) if path.endswith('.mjb')
                       else mujoco.MjModel.from_xml_path(path))
        except (ValueError, OSError) as error:
            raise DataError(f'{path}: cannot load the model: {error}') from None

    def show(self, positions: np.ndarray) -> None:
        """Put everything to these positions [rad, m]."""
        self.data.qpos[:] = positions
        mujoco.mj_forward(self.model, self.data)


class Camera:
    """Takes off-screen pictures; use it in a ``with`` block."""

    def __init__(self, arm: Arm | Stage, size: tuple[int, int] = (960, 720)):
        """
        Open.

        :param size: width and height [pixels]
        :raises NoScreenError: if off-screen rendering is not possible; names the package to
            install
        """
        self._arm = arm
        # -1, for a model without this camera, is the default view.
        self._camera = mujoco.mj_name2id(arm.model, mujoco.mjtObj.mjOBJ_CAMERA, 'overview')
        _enlarge_buffer(arm.model, size)
        try:
            self._renderer = mujoco.Renderer(arm.model, size[1], size[0])
        except Exception as error:
            raise NoScreenError('no off-screen rendering: install libegl1 (MUJOCO_GL=egl) or '
                                f'libosmesa6 (MUJOCO_GL=osmesa) [{type(error).__name__}]'
                                ) from None

    def __enter__(self) -> Camera:
        return self

    def __exit__(self, *_: object) -> None:
        self._renderer.close()

    def take(self, path: np.ndarray | None = None) -> np.ndarray:
        """
        Take a picture of the present state, shape ``(height, width, 3)`` uint8.

        :param path: positions to draw as a line of small spheres [m], shape ``(T, 3)``
        """
        self._renderer.update_scene(self._arm.data, camera=self._camera)
        for position in path if path is not None else ():
            _add_sphere(self._renderer.scene, position)
        return np.array(self._renderer.render())


def _enlarge_buffer(model: mujoco.MjModel, size: tuple[int, int]) -> None:
    """Make the off-screen buffer of a model large enough."""
    buffer = model.vis.global_
    buffer.offwidth = max(buffer.offwidth, size[0])
    buffer.offheight = max(buffer.offheight, size[1])


def _add_sphere(scene: Any, position: np.ndarray) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    mujoco.mjv_initGeom(scene.geoms[scene.ngeom], mujoco.mjtGeom.mjGEOM_SPHERE,
                        np.array([0.004, 0.0, 0.0]), np.asarray(position, dtype=float),
                        np.eye(3).reshape(-1), np.array([0.85, 0.2, 0.15, 1.0], dtype=np.float32))
    scene.ngeom += 1

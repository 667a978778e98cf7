"""A window with a simulated arm, and off-screen pictures of it."""
from __future__ import annotations

import os
import sys
from typing import Any

import mujoco
import numpy as np

from gdmp_ros.errors import DataError
from gdmp_ros.sim.arm import Arm

#: Directions in which a camera may look [°]: about the vertical, the first one by preference, and
#: downwards; and its distance / extent of the model.
_AROUND, _DOWN, _AWAY = (140.0, 180.0, 220.0, 260.0, 100.0, 60.0, 300.0), (-20.0, -35.0), 1.6


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
        self._camera: int | mujoco.MjvCamera = mujoco.mj_name2id(
            arm.model, mujoco.mjtObj.mjOBJ_CAMERA, 'overview')
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

    def aim(self, path: np.ndarray) -> None:
        """
        Look from where most of a path is seen, in the present state.

        :param path: positions [m], shape ``(T, 3)``
        """
        model, most = self._arm.model, -1
        middle = 0.5 * (model.stat.center + path.mean(axis=0))
        for elevation in _DOWN:
            for azimuth in _AROUND:
                camera = mujoco.MjvCamera()
                camera.lookat, camera.distance = middle, _AWAY * model.stat.extent
                camera.azimuth, camera.elevation = azimuth, elevation
                turn, down = np.deg2rad([azimuth, elevation])
                eye = middle - camera.distance * np.array([
                    np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), np.sin(down)])
                seen = sum(self._is_seen(eye, position) for position in path)
                if seen > most:
                    most, self._camera = seen, camera

    def _is_seen(self, eye: np.ndarray, position: np.ndarray) -> bool:
        hit = mujoco.mj_ray(self._arm.model, self._arm.data, eye, position - eye, None, 1, -1,
                            np.zeros(1, dtype=np.int32))
        return bool(hit < 0.0 or hit > 1.0)

    def take(self, path: np.ndarray | None = None) -> np.ndarray:
        """
        Take a picture of the present state, shape ``(height, width, 3)`` uint8.

        :param path: positions to draw as a line [m], shape ``(T, 3)``
        """
        self._renderer.update_scene(self._arm.data, camera=self._camera)
        for first, last in zip(path[:-1], path[1:]) if path is not None else ():
            _add_line(self._renderer.scene, first, last)
        return np.array(self._renderer.render())


def _enlarge_buffer(model: mujoco.MjModel, size: tuple[int, int]) -> None:
    """Make the off-screen buffer of a model large enough."""
    buffer = model.vis.global_
    buffer.offwidth = max(buffer.offwidth, size[0])
    buffer.offheight = max(buffer.offheight, size[1])


def _add_line(scene: Any, first: np.ndarray, last: np.ndarray) -> None:
    if scene.ngeom >= scene.maxgeom:
        return
    line = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(line, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), np.zeros(3),
                        np.eye(3).reshape(-1), np.array([0.85, 0.2, 0.15, 1.0], dtype=np.float32))
    mujoco.mjv_connector(line, mujoco.mjtGeom.mjGEOM_CAPSULE, 0.004,
                         np.asarray(first, dtype=float), np.asarray(last, dtype=float))
    scene.ngeom += 1

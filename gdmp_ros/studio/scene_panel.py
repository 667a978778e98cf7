"""The panel of what stands around the arm: added, dragged, removed, saved."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.scene import Scene, Volume, write_scene
from gdmp_ros.studio.app import Studio

NONE = 'nothing yet'
#: What is added, and where [m].
SIZES = {'box': (0.1, 0.1, 0.1), 'sphere': (0.05,), 'capsule': (0.03, 0.2)}
PLACE = np.array([0.45, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])


class ScenePanel:
    """Changes the surroundings of the arm; the handle in space drags what is chosen."""

    def __init__(self, studio: Studio):
        self._studio, gui = studio, studio.server.gui
        gui.add_markdown('The arm keeps away from these, and motions are led around them.')
        self._kind = gui.add_dropdown('kind', tuple(SIZES))
        gui.add_button('add something').on_click(studio.later(self._add))
        self._choice = gui.add_dropdown('thing', (NONE,))
        self._choice.on_update(studio.later(self._show))
        self._size = gui.add_vector3('size [m]', (0.1, 0.1, 0.1), step=0.005,
                                     hint='box: edges; sphere: radius; capsule: radius, length')
        self._size.on_update(studio.entered(self._resize, 'size'))
        gui.add_button('remove it').on_click(studio.later(self._remove))
        self._file = gui.add_text('scene file', 'scene.yaml')
        self._replace = gui.add_checkbox('replace an existing scene', False)
        gui.add_button('save the scene').on_click(studio.later(self._save))
        studio.on_opened.append(self._opened)
        studio.on_motion.append(self._show)
        self._last = Scene()
        if len(studio.bench.scene):
            studio.jobs.put(self._opened)

    def _chosen(self) -> Volume:
        scene = self._studio.bench.scene
        if self._choice.value not in scene:
            raise DataError('nothing is chosen: add something first')
        return scene[self._choice.value]

    def _change(self, volume: Volume) -> None:
        scene = self._studio.bench.scene.copy()
        scene.put(volume)
        self._studio.surround(scene)

    def _add(self) -> None:
        scene, kind, number = self._studio.bench.scene, self._kind.value, 1
        while f'{kind} {number}' in scene:
            number += 1
        self._change(Volume(f'{kind} {number}', kind, SIZES[kind], PLACE.copy()))
        self._choice.value = f'{kind} {number}'
        self._show()

    def _resize(self, size: tuple[float, float, float]) -> None:
        chosen = self._chosen()
        self._change(Volume(chosen.name, chosen.kind, size[:len(chosen.size)], chosen.pose,
                            margin=chosen.margin, allowed=chosen.allowed))

    def _remove(self) -> None:
        scene, name = self._studio.bench.scene.copy(), self._chosen().name
        scene.remove(name)
        self._studio.surround(scene)

    def _save(self) -> None:
        path = Path(self._file.value.strip())
        if path.suffix not in ('.yaml', '.yml'):
            raise DataError(f'scene file {path}: expected a name that ends in .yaml')
        if path.exists() and not self._replace.value:
            raise DataError(f'{path}: exists already; tick "replace an existing scene", or choose '
                            'another name')
        write_scene(path, self._studio.bench.scene)
        self._studio.notify('saved', str(path.absolute()), 'green')

    def _opened(self) -> None:
        """Use a scene that was opened."""
        bench = self._studio.bench
        if bench.scene is not self._last:
            before, self._last = self._last, bench.scene
            try:
                self._studio.surround(self._last)
            except GdmpError:
                bench.scene = self._last = before
                raise

    def _show(self) -> None:
        scene = self._studio.bench.scene
        names = scene.names or (NONE,)
        if self._choice.options != names:
            self._choice.options = names
        for name in self._studio.scene.handles('thing '):
            if name != f'thing {self._choice.value}':
                self._studio.scene.handle(name, None)
        if self._choice.value in scene:
            chosen = scene[self._choice.value]
            size = [*chosen.size, 0.0, 0.0][:3]
            self._size.value = (size[0], size[1], size[2])
            self._studio.scene.handle(f'thing {chosen.name}', chosen.pose, self._drag)

    def _drag(self, pose: np.ndarray, released: bool) -> None:
        studio = self._studio

        def move() -> None:
            chosen = self._chosen()
            self._change(Volume(chosen.name, chosen.kind, chosen.size, pose,
                                margin=chosen.margin, allowed=chosen.allowed))
        studio.jobs.put(move, None if released else 'drag thing')

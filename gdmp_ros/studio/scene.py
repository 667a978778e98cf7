"""What the page draws in space: arm, paths, tubes, ellipsoids, marks, handles."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import trimesh
import viser

from gdmp_ros.scene import Volume
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.urdf import Shape, shapes
from gdmp_ros.studio.first_view import extent, FIELD_OF_VIEW, first_view, View
from gdmp_ros.studio.motion import ShownMotion
from gdmp_ros.view import style

#: Width below which viser shows the panel of a phone [pixels], and the share of the height that it
#: covers until it is folded.
PHONE, COVERED = 576, 0.6
#: Radius of a mark [m].
_MARK = 0.008
#: Marks and handles beside a path with a smaller diagonal [m] are smaller; the least scale.
_USUAL, _LEAST_SCALE = 0.2, 0.1
#: Thickness of lines [pixels].
_LINE = 3.0
#: Views that differ by less are the same [m].
_SAME = 1e-3
_GHOST = (90, 140, 220)
_Colour = tuple[int, int, int]



_BALL = trimesh.creation.icosphere(subdivisions=2)


def colour(number: int) -> _Colour:
    """Colour of the ``number``-th curve, as in the figures."""
    text = style.INK[number % len(style.INK)].lstrip('#')
    return int(text[:2], 16), int(text[2:4], 16), int(text[4:], 16)


class ArmModel:
    """An arm, one node for each body."""

    def __init__(self, scene: viser.SceneApi, arm: Arm, name: str, tint: _Colour | None = None):
        """
        Draw it.

        :param arm: is moved to the postures that are shown
        :param tint: colour of all its parts, which can be looked through then
        """
        self._arm, self._shown, self._hidden = arm, np.empty(0), False
        self._fingers = slice(len(arm.names), arm.model.nq)
        bodies: dict[int, list[Shape]] = {}
        for shape in shapes(arm):
            bodies.setdefault(shape.body, []).append(shape)
        self._root = scene.add_frame(name, show_axes=False)
        self._frames = {}
        for body, parts in bodies.items():
            place = f'{name}/{arm.model.body(body).name}'
            self._frames[body] = scene.add_frame(place, show_axes=False)
            colours = {tuple(part.colour) for part in parts}
            for number, painted in enumerate(sorted(colours)):
                mesh = trimesh.util.concatenate([_mesh(part) for part in parts
                                                 if tuple(part.colour) == painted])
                shade = tint or tuple(int(255 * value) for value in painted[:3])
                scene.add_mesh_simple(f'{place}/{number}', mesh.vertices, mesh.faces, color=shade,
                                      opacity=None if tint is None else 0.35, flat_shading=False,
                                      cast_shadow=tint is None,
                                      # Surfaces of two arms in one posture would flicker.
                                      scale=1.0 if tint is None else 1.01)

    def hide(self, hidden: bool) -> None:
        """Hide it whatever its posture, or not any more."""
        self._hidden = hidden
        self._root.visible = not hidden

    def show(self, joints: np.ndarray | None, width: float | None = None) -> None:
        """
        Show a posture [rad]; None hides the arm.

        :param width: between the fingers [m], of a model with moving ones
        """
        visible = joints is not None and not self._hidden
        if self._root.visible != visible:
            self._root.visible = visible
        fingers = self._arm.data.qpos[self._fingers]
        if joints is None:
            return
        if width is not None:
            fingers = np.full(len(fingers), 0.5 * width)
        places = np.concatenate([joints, fingers])
        if np.array_equal(places, self._shown):
            return
        self._shown = places
        self._arm.show(joints, fingers)
        data = self._arm.data
        for body, frame in self._frames.items():
            frame.position, frame.wxyz = data.xpos[body].copy(), data.xquat[body].copy()


def _mesh(shape: Shape) -> trimesh.Trimesh:
    if shape.kind == 'box':
        mesh = trimesh.creation.box(shape.size)
    elif shape.kind == 'sphere':
        mesh = trimesh.creation.icosphere(subdivisions=2, radius=0.5 * shape.size[0])
    else:
        mesh = trimesh.creation.cylinder(0.5 * shape.size[0], shape.size[2], sections=24)
    mesh.apply_transform(trimesh.transformations.quaternion_matrix(shape.pose[3:]))
    mesh.apply_translation(shape.pose[:3])
    return mesh


#: Colours: of a path before a correction, of one around obstacles, of these.
BEFORE, _AROUND, _VOLUME = (0, 170, 200), (20, 130, 60), (217, 115, 51)
#: What can be hidden, with its colour and what it is.
LAYERS: dict[str, tuple[_Colour | None, str]] = {
    'arm': (None, 'the arm'), 'path': (colour(1), 'the path of the skill; red: out of reach'),
    'around': (_AROUND, 'the path that is executed: around what is in the way'),
    'before': (BEFORE, 'the path before a correction'), 'surroundings': (_VOLUME, 'obstacles'),
    'takes': ((150, 150, 150), 'takes'), 'variation': (colour(3), '95 % of takes lie inside'),
    'stiffness': (colour(2), 'stiffness: long where the arm is stiff'),
    'run': (colour(5), 'what was sent, in a recorded run'),
    'past': (colour(0), 'where the tool has been')}
#: Ellipsoids would hide the path.
HIDDEN_AT_FIRST = frozenset({'stiffness', 'variation'})
_OF_LAYER = {'sent': 'run', 'skill ': 'path', 'step ': 'path', 'take ': 'takes'}


def _layer(name: str) -> str:
    """The layer of a line or of ellipsoids."""
    return next((layer for start, layer in _OF_LAYER.items() if name.startswith(start)), name)


def _turn(camera: Any, view: View) -> None:
    camera.position, camera.look_at = view.eye, view.looked_at


def _is_near(one: View, other: View) -> bool:
    return bool(np.allclose(one.eye, other.eye, atol=_SAME)
                and np.allclose(one.looked_at, other.looked_at, atol=_SAME))


class Scene:
    """
    The scene of one page.

    :ivar arm: that the robot is
    """

    def __init__(self, server: viser.ViserServer, arm: Arm, ghost: Arm):
        """:param ghost: the same model again; shown where the arm would be"""
        self._scene = server.scene
        self._scene.set_up_direction('+z')
        self._server = server
        self._scene.add_grid('/floor', 2.0, 2.0, cell_size=0.1, section_size=0.5, plane='xy')
        self._scene.add_frame('/base', axes_length=0.1, axes_radius=0.003)
        self.arm = ArmModel(self._scene, arm, '/arm')
        self.ghost = ArmModel(self._scene, ghost, '/ghost', _GHOST)
        self.ghost.show(None)
        self._tool = self._scene.add_frame('/tool', axes_length=0.07, axes_radius=0.003,
                                           visible=False)
        self._hidden = set(HIDDEN_AT_FIRST)
        self._lines: dict[str, Any] = {}
        self._batches: dict[str, Any] = {}
        self._handles: dict[str, tuple[Any, float]] = {}
        self._marks: dict[str, Any] = {}
        self._volumes: dict[str, Any] = {}
        self._notes: list[Any] = []
        self.look(None)
        server.on_client_connect(self._join)

    def look(self, path: np.ndarray | None) -> None:
        """Look at a path: in browsers that come, and in those that are there; see `first_view`."""
        self._looked_at = path
        size = extent(path) or _USUAL
        self._scale = min(max(size / _USUAL, _LEAST_SCALE), 1.0)
        for ball in self._marks.values():
            ball.scale = self._scale
        for handle, scale in self._handles.values():
            handle.scale = scale * self._scale
        self._server.initial_camera.fov = np.radians(FIELD_OF_VIEW)
        _turn(self._server.initial_camera, first_view(path))
        for client in self._server.get_clients().values():
            self._turn(client)

    def _join(self, client: viser.ClientHandle) -> None:
        self._turn(client)
        client.camera.on_update(lambda _: self._turn_from_general(client))

    def _turn(self, client: viser.ClientHandle) -> None:
        """Show a browser the whole path, also one that is narrow, or has a panel below."""
        _turn(client.camera, self._view_of(client))

    def _view_of(self, client: viser.ClientHandle) -> View:
        camera = client.camera
        return first_view(self._looked_at, camera.aspect,
                          COVERED if camera.image_width < PHONE else 0.0)

    def _turn_from_general(self, client: viser.ClientHandle) -> None:
        """Turn a browser with the view of all browsers: it may come later than its own one."""
        camera, general = client.camera, first_view(self._looked_at)
        if (_is_near(View(camera.position, camera.look_at), general)
                and not _is_near(self._view_of(client), general)):
            self._turn(client)

    def show(self, layer: str, visible: bool) -> None:
        """
        Show or hide one of `LAYERS`.

        :param layer: its name
        """
        (self._hidden.discard if visible else self._hidden.add)(layer)
        for name, drawn in [*self._lines.items(), *self._batches.items()]:
            if _layer(name) == layer:
                drawn.visible = visible
        if layer == 'arm':
            self.arm.hide(not visible)
        for drawn in self._volumes.values() if layer == 'surroundings' else ():
            drawn.visible = visible

    def line(self, name: str, positions: np.ndarray | None, paint: _Colour,
             wrong: np.ndarray | None = None) -> None:
        """
        Draw a path, or remove it.

        :param positions: shape ``(T, 3)`` [m]; None removes the line
        :param wrong: whether a sample is drawn red
        """
        if positions is None or len(positions) < 2:
            result = self._lines.pop(name, None)
            if result is not None:
                result.remove()
            return
        pairs = np.stack([positions[:-1], positions[1:]], axis=1).astype(np.float32)
        colours = np.full((*pairs.shape[:2], 3), paint, dtype=np.uint8)
        if wrong is not None:
            colours[wrong[:-1]] = (220, 20, 20)
        if name in self._lines:
            self._lines[name].points, self._lines[name].colors = pairs, colours
        else:
            self._lines[name] = self._scene.add_line_segments(
                f'/lines/{name}', pairs, colours, thickness=_LINE, thickness_units='screen',
                visible=_layer(name) not in self._hidden)

    def stiffness(self, motion: ShownMotion | None) -> None:
        """Ellipsoids along a motion, long where the arm is stiff; the longest has one length."""
        self._ellipsoids('stiffness', None if motion is None or motion.stiffness is None else
                         style.of_stiffness(motion.poses[:, :3], motion.stiffness)[0],
                         colour(2), 0.35)

    def tube(self, likely: tuple[np.ndarray, np.ndarray] | None) -> None:
        """Ellipsoids in which 95 % of takes lie; None removes them."""
        self._ellipsoids('variation', None if likely is None else
                         style.of_takes(likely[0][:, :3], likely[1][:, :3, :3]), colour(3), 0.15)

    def _ellipsoids(self, name: str, ellipsoids: style.Ellipsoids | None, paint: _Colour,
                    opacity: float) -> None:
        if ellipsoids is None:
            result = self._batches.pop(name, None)
            if result is not None:
                result.remove()
            return
        lengths, rotations = ellipsoids.oriented()
        positions = ellipsoids.positions
        if name in self._batches:
            batch = self._batches[name]
            batch.batched_positions = positions.astype(np.float32)
            batch.batched_wxyzs = rotations.astype(np.float32)
            batch.batched_scales = lengths.astype(np.float32)
        else:
            self._batches[name] = self._scene.add_batched_meshes_simple(
                f'/ellipsoids/{name}', _BALL.vertices, _BALL.faces, rotations, positions,
                batched_scales=lengths, batched_colors=paint, opacity=opacity, lod='off',
                cast_shadow=False, receive_shadow=False,
                visible=_layer(name) not in self._hidden)

    def tool(self, pose: np.ndarray | None) -> None:
        """Show axes at a pose of the tool; None hides them."""
        self._tool.visible = pose is not None
        if pose is not None:
            self._tool.position, self._tool.wxyz = pose[:3], pose[3:]

    def volume(self, name: str, volume: Volume | None) -> None:
        """Draw something that stands around the arm, or remove it."""
        known = self._volumes.pop(name, None)
        if known is not None:
            known.remove()
        if volume is None or volume.kind == 'plane':
            return
        if volume.kind == 'box':
            mesh = trimesh.creation.box(volume.size)
        elif volume.kind == 'sphere':
            mesh = trimesh.creation.icosphere(subdivisions=3, radius=volume.radius)
        else:
            mesh = trimesh.creation.capsule(volume.size[1], volume.radius)
        self._volumes[name] = self._scene.add_mesh_simple(
            f'/volumes/{name}', mesh.vertices, mesh.faces, color=_VOLUME, opacity=0.6,
            position=volume.pose[:3], wxyz=volume.pose[3:],
            visible='surroundings' not in self._hidden)

    def volumes(self) -> Sequence[str]:
        """Names of the volumes that are drawn."""
        return list(self._volumes)

    def mark(self, name: str, pose: np.ndarray | None,
             clicked: Callable[[Any], Any] | None = None) -> None:
        """
        Mark something that can be moved by a small ball with its name; None removes it.

        :param clicked: called when it is clicked at
        """
        known = self._marks.get(name)
        if pose is None:
            if known is not None:
                known.remove()  # its label goes with it
                del self._marks[name]
            return
        if known is None:
            ball = self._scene.add_icosphere(f'/marks/{name}', _MARK, (230, 120, 20),
                                             subdivisions=2, cast_shadow=False,
                                             scale=self._scale)
            self._scene.add_label(f'/marks/{name}/label', name, anchor='bottom-left')
            known = self._marks[name] = ball
            if clicked is not None:
                ball.on_click(clicked)
        known.position = pose[:3]

    def notes(self, notes: Sequence[tuple[str, np.ndarray]]) -> None:
        """Write short texts at positions [m]; those of before go."""
        for drawn in self._notes:
            drawn.remove()
        self._notes = [self._scene.add_label(f'/notes/{number}', text, position=position,
                                             anchor='top-left')
                       for number, (text, position) in enumerate(notes)]

    def marks(self) -> Sequence[str]:
        """Names of what is marked."""
        return list(self._marks)

    def handle(self, name: str, pose: np.ndarray | None,
               moved: Callable[[np.ndarray, bool], None] | None = None, scale: float = 0.16,
               turns: bool = True) -> None:
        """
        Put a handle that can be dragged to a pose; None removes it.

        :param moved: called with the pose while it is dragged, and whether it is released
        :param scale: length of its arrows beside a path of usual size [m]
        :param turns: whether it can be turned too
        """
        known = self._handles.get(name)
        if pose is None:
            if known is not None:
                known[0].remove()
                del self._handles[name]
            return
        if known is not None:
            known[0].position, known[0].wxyz = pose[:3], pose[3:]
            return
        created = self._scene.add_transform_controls(
            f'/handles/{name}', scale * self._scale, disable_rotations=not turns, depth_test=False,
            position=pose[:3], wxyz=pose[3:])
        self._handles[name] = created, scale
        if moved is not None:
            # On the event loop: in a pool of threads events may overtake each other.
            async def event(update: viser.TransformControlsEvent) -> None:
                target = update.target
                moved(np.concatenate([target.position, target.wxyz]), update.phase == 'end')
            created.on_update(event)

    def lines(self, prefix: str) -> Sequence[str]:
        """Names of lines."""
        return [name for name in self._lines if name.startswith(prefix)]

    def handles(self, prefix: str) -> Sequence[str]:
        """Names of handles."""
        return [name for name in self._handles if name.startswith(prefix)]

"""Markers and messages as volumes, and volumes as markers and messages."""
from __future__ import annotations

import math
from typing import Any

from gdmp_msgs.msg import Scene as SceneMessage
from gdmp_msgs.msg import Volume as VolumeMessage
import numpy as np
from visualization_msgs.msg import Marker, MarkerArray

from gdmp_ros.errors import DataError
from gdmp_ros.ros.messages import set_pose, set_vectors
from gdmp_ros.scene.points import volumes_around
from gdmp_ros.scene.scene import Scene
from gdmp_ros.scene.volume import Volume

#: Kinds of markers that are lists of points.
_POINTS = (Marker.POINTS, Marker.LINE_STRIP, Marker.LINE_LIST, Marker.TRIANGLE_LIST,
           Marker.SPHERE_LIST, Marker.CUBE_LIST)


def numbers_of(pose: Any) -> np.ndarray:
    """Pose of a message (x, y, z, qw, qx, qy, qz); a quaternion of zeros turns nothing."""
    place, turn = pose.position, pose.orientation
    result = np.array([place.x, place.y, place.z, turn.w, turn.x, turn.y, turn.z])
    if not result[3:].any():
        result[3] = 1.0  # as viewers take it
    return result


def marker_name(marker: Marker) -> str:
    """Name of the volume of a marker: its text, or namespace and number."""
    return marker.text or f'{marker.ns}/{marker.id}'


def volumes_of(marker: Marker) -> list[Volume]:
    """
    Volumes of a marker, in its frame: of its name, or several boxes around its points.

    :raises DataError: if it is none
    """
    name, scale = marker_name(marker), marker.scale
    pose, size = numbers_of(marker.pose), (scale.x, scale.y, scale.z)
    if not np.isfinite([*pose, *size]).all():
        raise DataError(f'marker {name!r}: not finite')
    if marker.type == Marker.CUBE:
        return [Volume(name, 'box', size, pose)]
    if marker.type == Marker.SPHERE:
        return [Volume(name, 'sphere', (0.5 * max(size),), pose)]
    if marker.type == Marker.CYLINDER:
        return [Volume(name, 'capsule', (0.5 * max(size[:2]), size[2]), pose)]
    if marker.type in _POINTS:
        points = np.array([(point.x, point.y, point.z) for point in marker.points])
        if marker.type == Marker.TRIANGLE_LIST:
            points = points.reshape(-1, 3) * size
            if len(points) % 3:
                raise DataError(f'marker {name!r}: {len(points)} points are no triangles')
            return volumes_around(name, points, np.arange(len(points)).reshape(-1, 3), pose=pose)
        return volumes_around(name, points, most=1, pose=pose, thickness=max(size)
                              if marker.type in (Marker.SPHERE_LIST, Marker.CUBE_LIST) else 0.0)
    raise DataError(f'marker {name!r}: type {marker.type} is no volume; expected CUBE, SPHERE, '
                    'CYLINDER, or a list of points or triangles')


def markers_of(scene: Scene, frame: str, stamp: Any) -> MarkerArray:
    """
    Markers of a scene, for ``~/scene`` and for viewers; without planes and what is carried.

    :param frame: ``frame_id`` of the base
    """
    result = MarkerArray()
    for number, volume in enumerate(scene.around):
        if volume.kind == 'plane':
            continue
        marker = Marker(ns='scene', id=number, text=volume.name)
        marker.header.frame_id, marker.header.stamp = frame, stamp
        set_pose(marker.pose, volume.pose)
        size = {'sphere': (2.0 * volume.radius,) * 3, 'box': volume.size,
                'capsule': (2.0 * volume.radius, 2.0 * volume.radius, volume.size[-1])}
        marker.type = {'sphere': Marker.SPHERE, 'box': Marker.CUBE,
                       'capsule': Marker.CYLINDER}[volume.kind]
        marker.scale.x, marker.scale.y, marker.scale.z = size[volume.kind]
        colour = marker.color
        colour.r, colour.g, colour.b, colour.a = 0.85, 0.45, 0.2, 0.7
        result.markers.append(marker)
    return result


def scene_message(scene: Scene, frame: str, stamp: Any) -> SceneMessage:
    """Message of a scene; `scene_of` is the way back."""
    result = SceneMessage(margin=scene.margin)
    result.header.frame_id, result.header.stamp = frame, stamp
    for volume in scene:
        message = VolumeMessage(
            name=volume.name, kind=volume.kind, size=volume.size, carried=volume.carried,
            margin=math.nan if volume.margin is None else volume.margin, allowed=volume.allowed)
        set_pose(message.pose, volume.pose)
        set_vectors(message.twist.linear, message.twist.angular, volume.twist)
        result.volumes.append(message)
    return result


def scene_of(message: SceneMessage) -> Scene:
    """
    Scene of a message.

    :raises DataError: if it is none
    """
    volumes = []
    for given in message.volumes:
        line, turn = given.twist.linear, given.twist.angular
        volumes.append(Volume(
            given.name, given.kind, tuple(given.size), numbers_of(given.pose),
            np.array([line.x, line.y, line.z, turn.x, turn.y, turn.z]),
            None if math.isnan(given.margin) else given.margin, tuple(given.allowed),
            given.carried))
    return Scene(volumes, message.margin)

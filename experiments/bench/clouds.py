"""Clouds of points: CPU load of an arm that follows them, and of one that only receives them."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
import tempfile
from typing import Any, TYPE_CHECKING

import numpy as np
import psutil

from experiments import timing
from gdmp_ros.scene import Volume
from gdmp_ros.util.dds_network import Domain
from gdmp_ros.util.optional_imports import optional_import, ROS

if TYPE_CHECKING:
    from gdmp_ros.ros.clients.testbed import NodeTestbed

TITLE = 'clouds of 300,000 points, ten a second: cores of the node of an arm'
#: Points of a cloud, rate [Hz], and longest part of the measurement [s].
POINTS, RATE_HZ, LONGEST_S = 300_000, 10.0, 20.0
#: The camera is 1.2 m above the base, in front of it, and looks down.
_EYE = np.array([0.5, 0.0, 1.2, 0.0, 1.0, 0.0, 0.0])
#: What stands on the floor.
_BOXES = [Volume(f'{k}', 'box', size, np.array([*place, 1.0, 0.0, 0.0, 0.0]))
          for k, (place, size) in enumerate((
              ((0.55, 0.25, 0.08), (0.1, 0.1, 0.16)), ((0.65, -0.2, 0.1), (0.1, 0.15, 0.2)),
              ((0.35, -0.35, 0.15), (0.06, 0.06, 0.3)), ((0.8, 0.3, 0.05), (0.1, 0.2, 0.1))))]


def seen(volumes: Sequence[Volume], rng: np.random.Generator, count: int, noise: float,
         eye: np.ndarray, wide: tuple[float, float] = (0.8, 0.6)) -> np.ndarray:
    """
    Points that a camera, which looks down, sees of boxes and of the floor.

    :param noise: standard deviation [m]
    :param eye: pose of the camera; its axes are x, -y and -z of the base
    :param wide: tangents of half of the angles of view
    :returns: in the frame of the camera, shape (count, 3) [m]
    """
    ways = np.column_stack([wide * rng.uniform(-1.0, 1.0, (count, 2)), np.ones(count)])
    base = ways * [1.0, -1.0, -1.0]
    depth = np.full(count, eye[2])
    for box in volumes:
        first, last = ((box.pose[:3] + side * box.half - eye[:3]) / base for side in (-1.0, 1.0))
        enters, leaves = np.minimum(first, last).max(axis=1), np.maximum(first, last).min(axis=1)
        depth = np.where((enters < leaves) & (enters < depth), enters, depth)
    return np.asarray(ways * depth[:, None] + rng.normal(0.0, noise, (count, 3)))


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """Send an arm no clouds, such that it refuses after reading them, and such that it uses."""
    with optional_import(ROS):
        from gdmp_ros.ros.clients.testbed import NodeTestbed
    seconds = min(settings.seconds, LONGEST_S)
    with (tempfile.TemporaryDirectory(prefix='gdmp-clouds-') as name, Domain() as domain,
          NodeTestbed(Path(name), domain.environment()) as bed):
        return _measured(bed, seconds)


def _measured(bed: NodeTestbed, seconds: float) -> dict[str, Any]:
    from gdmp_msgs.msg import Scene
    from sensor_msgs.msg import PointCloud2, PointField
    from tf2_msgs.msg import TFMessage

    from gdmp_ros.ros.messages import stamp_of, stamped_transform
    from gdmp_ros.ros.middleware import latched
    bed.start_arm(headless=True)
    client, node = bed.client, bed.arm.node
    fixed = client.participant.publisher(TFMessage, '/tf_static', latched(1))
    fixed.publish(TFMessage(transforms=[stamped_transform(bed.arm.frame, 'camera', _EYE)]))
    scenes: list[Scene] = []
    client.participant.subscription(Scene, f'{node}/surroundings', latched(1), scenes.append)
    topic = client.publisher(PointCloud2, f'{node}/cloud', 1)
    bed.wait('the arm', lambda: topic.subscribers() > 0, 60.0)
    rng = np.random.default_rng(1)
    clouds = [PointCloud2(
        height=1, width=POINTS, point_step=16, row_step=16 * POINTS, is_bigendian=False,
        data=np.pad(seen(_BOXES, rng, POINTS, 0.002, _EYE).astype('<f4'),
                    ((0, 0), (0, 1))).tobytes(),
        fields=[PointField(name=field, offset=4 * k, datatype=PointField.FLOAT32, count=1)
                for k, field in enumerate('xyz')]) for _ in range(3)]
    process = psutil.Process(bed.children.processes[node].pid)

    def cores(message: dict[str, Any] | None) -> float:
        """:param message: fields of the clouds; None: none is sent"""
        bed.spend(2.0)
        used, begun, count = sum(process.cpu_times()[:2]), client.now(), 0
        while client.now() - begun < seconds:
            if message is not None:
                cloud = clouds[count % len(clouds)]
                cloud.header.frame_id = 'camera'
                cloud.header.stamp = stamp_of(client.clock.wall())
                for field, value in message.items():
                    setattr(cloud, field, value)
                topic.publish(cloud)
            count += 1
            bed.spend(max(begun + count / RATE_HZ - client.now(), 0.0))
        return float(sum(process.cpu_times()[:2]) - used) / (client.now() - begun)
    alone, received = cores(None), cores({'is_bigendian': True})
    followed = cores({'is_bigendian': False})
    return {'seconds': seconds, 'points': POINTS, 'rate_hz': RATE_HZ, 'alone': alone,
            'received': received, 'followed': followed, 'beyond_receiving': followed - received,
            'boxes': len(scenes[-1].volumes) if scenes else 0, 'scenes': len(scenes)}


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heading, then lines."""
    lines = [('without clouds', 'alone'), ('received, and refused', 'received'),
             ('followed', 'followed'), ('beyond receiving', 'beyond_receiving')]
    return [['the arm', 'cores'], *([name, f'{document[key]:.3f}'] for name, key in lines)]

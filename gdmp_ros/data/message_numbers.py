"""Numbers of messages, as rclpy or as rosbags reads them."""
from __future__ import annotations

from typing import Any


def pose_numbers(pose: Any) -> list[float]:
    """(x, y, z, qw, qx, qy, qz) of a pose."""
    p, q = pose.position, pose.orientation
    return [p.x, p.y, p.z, q.w, q.x, q.y, q.z]


def vector_numbers(first: Any, second: Any) -> list[float]:
    """Six numbers of two vectors, as of a twist or a wrench."""
    return [first.x, first.y, first.z, second.x, second.y, second.z]

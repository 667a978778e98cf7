"""Publishes goals or invalid messages at 1 kHz until SIGTERM."""
from __future__ import annotations

import sys
import time
from typing import Any

from gdmp_msgs.msg import Reference
from geometry_msgs.msg import PoseStamped
import numpy as np
from std_msgs.msg import Float64MultiArray

from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import Client
from gdmp_ros.util.processes import stop_event

FRAME = 'panda_link0'
CENTRE = np.array([0.5, 0.0, 0.42, 0.0, 1.0, 0.0, 0.0])


def _pose(pose: np.ndarray, frame: str = FRAME) -> PoseStamped:
    message = PoseStamped()
    message.header.frame_id = frame
    messages.set_pose(message.pose, pose)
    return message


def goals(rng: np.random.Generator) -> tuple[PoseStamped, Float64MultiArray]:
    """A pose in the workspace and a stiffness."""
    pose = CENTRE.copy()
    pose[:3] += rng.uniform(-0.1, 0.1, 3)
    return _pose(pose), Float64MultiArray(data=np.diag(rng.uniform(200, 800, 3)).ravel().tolist())


def invalid(rng: np.random.Generator) -> tuple[Any, Any, Any]:
    """A pose, a stiffness and a reference, each invalid in a random way."""
    pose = CENTRE.copy()
    pose[rng.integers(7)] = rng.choice([np.nan, np.inf, -np.inf, 1e300, 5.0])
    frame = str(rng.choice([FRAME, 'world', '', 'x' * 500]))
    reference = Reference()
    numbers = np.concatenate([pose, rng.standard_normal(49) * 10.0 ** rng.integers(-3, 300)])
    messages.fill_reference(reference, numbers)
    reference.header.frame_id = frame
    reference.header.stamp = messages.stamp_of(
        time.time_ns() + int(rng.integers(-10, 11)) * 10 ** 9)
    reference.sequence = int(rng.integers(1 << 60))
    matrix = rng.standard_normal(int(rng.choice([0, 1, 9, 36, 37])))
    return _pose(pose, frame), Float64MultiArray(data=matrix.tolist()), reference


def main(what: str) -> int:
    """Publish; print the number of rounds at the end."""
    client, ended = Client('flood'), stop_event()
    publishers = [client.publisher(kind, f'trajectory_server/{name}', 1)
                  for kind, name in ((PoseStamped, 'goal_pose'),
                                     (Float64MultiArray, 'goal_stiffness'),
                                     (Reference, 'reference'))]
    while not ended.is_set() and not all(p.subscribers() for p in publishers):
        time.sleep(0.05)
    print('flooding', flush=True)
    rng, sent, deadline = np.random.default_rng(0), 0, time.monotonic()
    rounds = [goals(rng) if what == 'goals' else invalid(rng) for _ in range(500)]
    while not ended.is_set():
        for publisher, message in zip(publishers, rounds[sent % len(rounds)]):
            publisher.publish(message)
        sent += 1
        deadline = max(deadline + 1e-3, time.monotonic() - 0.1)
        time.sleep(max(deadline - time.monotonic(), 0.0))
    print(sent, flush=True)
    client.close()
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1]))

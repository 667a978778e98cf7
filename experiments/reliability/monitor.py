"""Counts references and states and keeps extreme values, in little memory."""
from __future__ import annotations

from pathlib import Path
import sys
import time
from typing import Any

from gdmp_msgs.msg import Reference, RobotState
import numpy as np

from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.data.runs import REFERENCE_TOPIC, STATE_GAP_NS, STATE_TOPIC
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.server_client import Client
from gdmp_ros.ros.middleware import DEEP
from gdmp_ros.ros.recorder.record import DRAIN_S
from gdmp_ros.ros.serialized import SerializedTemplate, stamp_ns_of
from gdmp_ros.util.files import write_json
from gdmp_ros.util.processes import stop_event

JOINTS = 7
#: Length of the windows of the extreme values [s].
WINDOW_S = 10.0


class Extremes:
    """Extreme values of a window."""

    def __init__(self) -> None:
        self.torque = np.zeros(JOINTS)
        self.rate = self.joint_speed = self.speed = 0.0
        self.tank = np.inf
        self.states = 0
        self.lower, self.upper = np.full(JOINTS, np.inf), np.full(JOINTS, -np.inf)

    def document(self) -> dict[str, Any]:
        """The values for a JSON file."""
        return {'states': self.states, 'torque': self.torque.tolist(), 'rate': self.rate,
                'speed': self.speed, 'joint_speed': self.joint_speed, 'tank': self.tank,
                'lower': self.lower.tolist(), 'upper': self.upper.tolist()}


class Monitor(Client):
    """Receives serialised messages and reads only the numbers that it needs."""

    def __init__(self, frame: str):
        super().__init__('monitor')
        self.received, self.lost, self.states = 0, 0, 0
        self.windows: list[dict[str, Any]] = []
        self._extremes, self._opened = Extremes(), time.monotonic()
        reference, state = Reference(), RobotState()
        reference.header.frame_id = state.header.frame_id = frame
        self._reference = SerializedTemplate(reference, TARGET_SIZE, messages.fill_reference)
        self._state = SerializedTemplate(state, messages.ROBOT_STATE_FIXED + 3 * JOINTS,
                                         messages.fill_robot_state)
        self._sequence, self._torque, self._stamp = 0, np.zeros(JOINTS), 0
        self._inputs = [(self.subscribe(kind, topic, depth=DEEP), use) for kind, topic, use in (
            (Reference, REFERENCE_TOPIC, self._on_reference),
            (RobotState, STATE_TOPIC, self._on_state))]

    def drain(self) -> None:
        """Process the messages that have arrived."""
        for subscription, use in self._inputs:
            while (received := subscription.take()) is not None:
                use(received.data)
        if time.monotonic() - self._opened > WINDOW_S:
            self.close_window()

    def close_window(self) -> None:
        """Close the present window."""
        self.windows.append(self._extremes.document())
        self._extremes, self._opened = Extremes(), time.monotonic()

    def _on_reference(self, data: bytes) -> None:
        sequence = self._reference.integers_of(data)[0]
        if self.received:
            self.lost += max(sequence - self._sequence - 1, 0)
        self._sequence = sequence
        self.received += 1

    def _on_state(self, data: bytes) -> None:
        numbers, stamp = self._state.numbers_of(data), stamp_ns_of(data)
        position, velocity, torque = numbers[messages.ROBOT_STATE_FIXED:].reshape(3, JOINTS)
        worst = self._extremes
        if self.states and stamp - self._stamp < STATE_GAP_NS:
            worst.rate = max(worst.rate, float(np.abs(torque - self._torque).max()))
        np.maximum(worst.torque, np.abs(torque), out=worst.torque)
        np.minimum(worst.lower, position, out=worst.lower)
        np.maximum(worst.upper, position, out=worst.upper)
        worst.joint_speed = max(worst.joint_speed, float(np.abs(velocity).max()))
        worst.speed = max(worst.speed, float(np.sqrt(numbers[7:10] @ numbers[7:10])))
        worst.tank = min(worst.tank, float(numbers[92]))
        self._torque, self._stamp = torque, stamp
        worst.states += 1
        self.states += 1


def main(path: str, frame: str) -> int:
    """Monitor until SIGTERM or SIGINT, then write the result to ``path``."""
    ended = stop_event()
    monitor, announced = Monitor(frame), False
    while not ended.is_set():
        monitor.drain()
        if monitor.received and monitor.states and not announced:
            print('monitoring', flush=True)
            announced = True
        time.sleep(DRAIN_S)
    monitor.drain()
    monitor.close_window()
    write_json(Path(path), {'received': monitor.received, 'lost': monitor.lost,
                            'states': monitor.states, 'windows': monitor.windows})
    monitor.close()
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))

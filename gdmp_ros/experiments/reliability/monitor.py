"""Watches references and states for as long as it takes, in little memory: counts and extremes."""
from __future__ import annotations

from pathlib import Path
import sys
import time
from typing import Any

from gdmp_msgs.msg import Reference, RobotState
import numpy as np
import rclpy
from rclpy.node import Node

from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.data.runs import REFERENCE_TOPIC, STATE_TOPIC
from gdmp_ros.experiments.reliability.motion import GAP_NS
from gdmp_ros.ros import messages
from gdmp_ros.ros.lifecycle import DEEP, PolledGroup, reliable, take
from gdmp_ros.ros.recorder.record import DRAIN_S
from gdmp_ros.util.atomic_write import write_json
from gdmp_ros.util.processes import stop_event

JOINTS = 7
#: Extremes are kept for windows of this length [s].
WINDOW_S = 10.0


class Extremes:
    """The worst of a window."""

    def __init__(self) -> None:
        self.torque = np.zeros(JOINTS)
        self.rate = self.joint_speed = self.speed = 0.0
        self.tank = np.inf
        self.states = 0
        self.lower, self.upper = np.full(JOINTS, np.inf), np.full(JOINTS, -np.inf)

    def document(self) -> dict[str, Any]:
        """As plain values."""
        return {'states': self.states, 'torque': self.torque.tolist(), 'rate': self.rate,
                'speed': self.speed, 'joint_speed': self.joint_speed, 'tank': self.tank,
                'lower': self.lower.tolist(), 'upper': self.upper.tolist()}


class Monitor(Node):
    """Takes everything raw and looks only at the numbers it needs."""

    def __init__(self, frame: str):
        super().__init__('monitor')
        self.received, self.lost, self.states = 0, 0, 0
        self.windows: list[dict[str, Any]] = []
        self._extremes, self._opened = Extremes(), time.monotonic()
        reference, state = Reference(), RobotState()
        reference.header.frame_id = state.header.frame_id = frame
        self._reference = messages.SerializedTemplate(reference, TARGET_SIZE, messages.fill_reference)
        self._state = messages.SerializedTemplate(state, messages.ROBOT_STATE_FIXED + 3 * JOINTS,
                                   messages.fill_robot_state)
        self._sequence, self._torque, self._stamp = 0, np.zeros(JOINTS), 0
        self._inputs = [(self.create_subscription(
            kind, topic, lambda _: None, reliable(DEEP), raw=True, callback_group=PolledGroup()),
            use) for kind, topic, use in ((Reference, REFERENCE_TOPIC, self._on_reference),
                                          (RobotState, STATE_TOPIC, self._on_state))]

    def drain(self) -> None:
        """Look at everything that has arrived."""
        for subscription, use in self._inputs:
            while (data := take(subscription)) is not None:
                use(data)
        if time.monotonic() - self._opened > WINDOW_S:
            self.close_window()

    def close_window(self) -> None:
        """Keep the extremes since the last time."""
        self.windows.append(self._extremes.document())
        self._extremes, self._opened = Extremes(), time.monotonic()

    def _on_reference(self, data: bytes) -> None:
        sequence = self._reference.sequence_of(data)
        if self.received:
            self.lost += max(sequence - self._sequence - 1, 0)
        self._sequence = sequence
        self.received += 1

    def _on_state(self, data: bytes) -> None:
        numbers, stamp = self._state.numbers_of(data), messages.stamp_ns_of(data)
        position, velocity, torque = numbers[messages.ROBOT_STATE_FIXED:].reshape(3, JOINTS)
        worst = self._extremes
        if self.states and stamp - self._stamp < GAP_NS:
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
    """Watch until SIGTERM or SIGINT, then write what was seen to ``path``."""
    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    ended = stop_event()
    monitor, said = Monitor(frame), False
    while not ended.is_set():
        monitor.drain()
        if monitor.received and monitor.states and not said:
            print('watching', flush=True)
            said = True
        time.sleep(DRAIN_S)
    monitor.drain()
    monitor.close_window()
    write_json(Path(path), {'received': monitor.received, 'lost': monitor.lost,
                            'states': monitor.states, 'windows': monitor.windows})
    rclpy.shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))

"""What a stream of references says of itself, and what an arm does."""
from __future__ import annotations

from enum import IntEnum


class StreamMode(IntEnum):
    """``mode`` of ``gdmp_msgs/Reference``."""

    STREAMING = 0
    HOLDING = 1
    ENDED = 2


class ArmMode(IntEnum):
    """``mode`` of ``gdmp_msgs/RobotState``."""

    UNKNOWN = 0
    HOLD = 1
    FOLLOW = 2
    GUIDED = 3
    COMPLIANT = 4
    IDENTIFY = 5
    FAULT = 6
    MOVE = 7
    STOP = 8

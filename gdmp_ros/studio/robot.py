"""What the page needs of a robot: simulated in this process, or behind running nodes."""
from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from gdmp_ros.control.gripper import GripperCommand
from gdmp_ros.dmp.sequence import SkillSequence
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.learning.correction import FollowedMotion
from gdmp_ros.scene import Scene


@dataclass(frozen=True)
class RobotView:
    """
    What a robot does at present.

    :ivar joints: positions [rad]
    :ivar pose: of the tool (x, y, z, qw, qx, qy, qz)
    :ivar goal: of the motion; None without one
    :ivar status: of the stream of references, as in ``ServerState``
    :ivar mode: of the arm, as in ``RobotState``
    :ivar progress: of the motion, 1 at its nominal end
    :ivar tempo: of the motion
    :ivar distance: of the tool from the goal [m, rad]
    :ivar tank: energy [J]
    :ivar limited: limits that act at present, with by how much
    :ivar recording: time of the take that is being recorded [s]; None without one
    :ivar problem: why something was refused or ended; empty without a reason
    :ivar rate: of its time to real time
    :ivar cycle: frequency [Hz] and amplitude of a rhythmic motion; None for others
    :ivar sequence: number of its step, how many there are, and its name; None without one
    :ivar width: between the fingers of its gripper [m]; None where it is not known
    """

    joints: np.ndarray
    pose: np.ndarray
    goal: np.ndarray | None
    status: str
    mode: str
    progress: float
    tempo: float
    distance: tuple[float, float]
    tank: float
    limited: tuple[str, ...]
    recording: float | None
    problem: str
    rate: float
    cycle: tuple[float, float] | None = None
    sequence: tuple[int, int, str] | None = None
    width: float | None = None

    @property
    def step(self) -> str:
        """The step of the sequence, as text; empty without one."""
        if self.sequence is None:
            return ''
        number, count, name = self.sequence
        return f'{number} of {count}, {name}'


class Robot(Protocol):
    """
    A robot that executes skills and can be guided by hand.

    Methods return at once, but for those of takes, which wait for an answer.

    :ivar name: for the page
    """

    name: str

    def view(self) -> RobotView | None:
        """What it does at present; None while nothing is known."""

    def use(self, skill: Skill, name: str) -> None:
        """
        Use a skill for the next start.

        :raises GdmpError: if the robot cannot use it
        """

    def start(self) -> None:
        """
        Start the skill from where the robot is.

        :raises GdmpError: if it cannot be started
        """

    def stop(self) -> None:
        """Stop what moves the robot smoothly."""

    def pause(self, paused: bool) -> None:
        """Stop on the path, or go on."""

    def set_tempo(self, tempo: float) -> None:
        """Change the tempo of this motion and of the next ones."""

    def set_amplitude(self, amplitude: float) -> None:
        """
        Change the amplitude of a rhythmic motion; 0 ends it.

        :raises GdmpError: if there is none
        """

    def start_sequence(self, sequence: SkillSequence, first: int) -> None:
        """
        Start a sequence that was read from a file.

        :param first: index of its first step
        :raises GdmpError: if it cannot be started
        """

    def signal(self, name: str) -> None:
        """Tell the present step of a sequence that something has happened."""

    def switch_goal(self, pose: np.ndarray) -> None:
        """
        Switch the goal of the motion.

        :raises GdmpError: if it is refused
        """

    def move_object(self, name: str, pose: np.ndarray) -> None:
        """Move an object of the motion; that of running nodes is where /tf has it."""

    def surround(self, scene: Scene) -> None:
        """
        Keep away from volumes, and lead motions around them.

        :raises GdmpError: if they are refused
        """

    def guide(self, guided: bool) -> None:
        """Let the arm be guided by hand, or let it hold."""

    def pull(self, pose: np.ndarray | None) -> None:
        """Pull the tool to a pose, of an arm that is guided or follows; None lets go."""

    def followed(self) -> FollowedMotion:
        """
        How the arm followed the last motion.

        :raises GdmpError: if there was none
        """

    def grip(self, command: GripperCommand) -> None:
        """
        Open or close the gripper; a take that is being recorded keeps the command.

        :raises GdmpError: if there is none, or it refuses the command
        """

    def record(self, folder: Path) -> None:
        """
        Begin a take.

        :raises GdmpError: if one is being recorded
        """

    def keep(self) -> Path:
        """
        End the take and write it; returns its bag.

        :raises GdmpError: if there is none, or it cannot be written
        """

    def discard(self) -> None:
        """Forget the take that is being recorded."""

    def home(self) -> None:
        """Move the arm to its home posture."""

    def close(self) -> None:
        """End everything that belongs to this robot."""

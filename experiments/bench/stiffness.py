"""What a streamed stiffness brings: an arm that takes positions wipes and inserts, in lockstep."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from experiments.baselines.admittance import DiagonalAdmittance
from experiments.position_trial import CYCLE, FAST
from experiments.timing import TimingSettings
from gdmp_ros.control.admittance import AdmittanceSettings, DAMPING_SHARE, LEVER_M
from gdmp_ros.control.target import resting_target, STIFFNESS, TWIST
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.servo_arm import PositionLoop, ServoArm
from gdmp_ros.util.profiles import minimum_jerk

TITLE = 'stiffness streamed, and fixed (UR5e, whole delay 8 ms, a cable pulls with 3 N)'
#: Stiffness of the foam and of the walls of the hole [N/m], and friction.
FOAM, WALL, FRICTION = 20_000.0, 30_000.0, 0.2
#: A cable pulls the tool all the time [N]; the force with which to wipe [N].
CABLE, WANTED = np.array([0.0, 2.2, -2.0]), 12.0
#: Stiff and soft [N/m], about the axes [Nm/rad].
STIFF, SOFT_NORMAL, SOFT_ASIDE, TURNING = 1500.0, 300.0, 150.0, 30.0
#: Heights of the board beside the one that was shown, and places of the hole beside it [m].
HEIGHTS, PLACES = (-0.01, 0.0, 0.01), ((0.0015, 0.0), (-0.0015, 0.0), (0.0, 0.0015))
#: How far it goes through the air [m].
ASIDE = 0.1
#: Chamfer, clearance and depth of the hole [m].
CHAMFER, CLEARANCE, DEEP = 0.004, 0.0002, 0.02
_REGULARISED = 0.002


class Contact(Protocol):
    """What a tool touches."""

    def __call__(self, at: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Force on the tool [N]; its position [m] and velocity [m/s]."""


def board(top: float) -> Contact:
    """Foam with friction; ``top`` is its height [m]."""
    def force(at: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        normal = max(FOAM * (top - at[2]), 0.0)
        aside = velocity[:2] / max(float(np.linalg.norm(velocity[:2])), _REGULARISED)
        return np.array([*(-FRICTION * normal * aside), normal])
    return force


def hole(centre: np.ndarray) -> Contact:
    """A round hole with a chamfer; ``centre`` is the middle of its top [m]."""
    def force(at: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        deep, away = centre[2] - at[2], at[:2] - centre[:2]
        if deep <= 0.0:
            return np.zeros(3)
        radius = float(np.linalg.norm(away))
        outwards = away / max(radius, 1e-9)
        if radius > CLEARANCE + CHAMFER:  # on the plate around it
            return np.array([0.0, 0.0, WALL * deep])
        upwards = 1.0 if deep < CHAMFER else 0.0
        allowed = CLEARANCE + upwards * (CHAMFER - deep)
        normal = WALL * max(radius - allowed, 0.0) / np.sqrt(1.0 + upwards)
        slides = float(np.clip(velocity[2] / _REGULARISED, -1.0, 1.0))
        along = np.array([*(-outwards), upwards]) / np.sqrt(1.0 + upwards)
        floor = WALL * max(deep - DEEP, 0.0)
        return np.array(normal * along + [0.0, 0.0, floor - FRICTION * normal * slides])
    return force


class Motion(NamedTuple):
    """
    A motion, as it was shown.

    :ivar poses: of the tool, shape (T, 7)
    :ivar stiffness: streamed, diagonal in the frame of the base, shape (T, 6)
    :ivar free: ticks in which nothing is touched
    :ivar touching: ticks in which something is
    """

    poses: np.ndarray
    stiffness: np.ndarray
    free: slice
    touching: slice


def _diagonal(aside: float, normal: float) -> np.ndarray:
    return np.array([aside, aside, normal, *[TURNING] * 3])


def _ticks(seconds: float) -> int:
    return round(seconds / CYCLE)


def wiping(home: np.ndarray, normal: float = SOFT_NORMAL) -> Motion:
    """
    Through the air, down to a board, twice around; soft along its normal while it is wiped.

    :param normal: stiffness that presses with the force that is wanted, at the height that was
        shown [N/m]
    """
    t = CYCLE * np.arange(_ticks(9.0))
    poses = np.tile(home, (len(t), 1))
    poses[:, 1] += ASIDE * minimum_jerk(np.clip(t / 2.0, 0.0, 1.0))
    down = minimum_jerk(np.clip((t - 2.0) / 2.0, 0.0, 1.0))
    share = np.clip(t - 2.0, 0.0, 1.0)
    poses[:, 2] -= (0.02 + WANTED / normal) * down
    angle = 4.0 * np.pi * minimum_jerk(np.clip((t - 4.0) / 5.0, 0.0, 1.0))
    poses[:, 0] += 0.05 * (np.cos(angle) - 1.0)
    poses[:, 1] += 0.05 * np.sin(angle)
    stiffness = np.array([_diagonal(STIFF, STIFF + s * (SOFT_NORMAL - STIFF)) for s in share])
    return Motion(poses, stiffness, slice(0, _ticks(1.9)), slice(_ticks(4.5), len(t)))


def insertion(home: np.ndarray) -> Motion:
    """Through the air, and down into a hole; soft aside as soon as the chamfer guides it."""
    t = CYCLE * np.arange(_ticks(7.0))
    poses = np.tile(home, (len(t), 1))
    poses[:, 1] += ASIDE * minimum_jerk(np.clip(t / 2.0, 0.0, 1.0))
    down = np.clip((t - 2.5) / 3.0, 0.0, 1.0)
    poses[:, 2] -= (0.005 + DEEP) * down
    share = np.clip((t - 3.2) / 0.5, 0.0, 1.0)
    stiffness = np.array([_diagonal(STIFF + s * (SOFT_ASIDE - STIFF), STIFF) for s in share])
    return Motion(poses, stiffness, slice(0, _ticks(1.9)), slice(_ticks(6.0), len(t)))


def follow(motion: Motion, contact: Contact, fixed: np.ndarray | None
           ) -> tuple[np.ndarray, np.ndarray]:
    """
    Let an arm follow a motion.

    :param fixed: stiffness of the controller with diagonal gains; None: ours, streamed
    :returns: where the tool was [m] and the force of the contact [N], both of shape (T, 3)
    """
    servo = ServoArm('ur5e', FAST)
    step = _ours(servo, motion) if fixed is None else _peer(servo, motion, fixed)
    arm, advance, felt = servo.arm, servo.advance, np.zeros(3)

    def touched(periods: int = 1) -> None:
        for _ in range(periods):
            measured = arm.measure()
            felt[:] = contact(measured.pose[:3], measured.jacobian[:3] @ measured.velocity)
            arm.push(np.array([*(felt + CABLE), 0.0, 0.0, 0.0]))
            advance()
    servo.advance = touched  # type: ignore[method-assign]
    places, forces = [], []
    for k in range(len(motion.poses)):
        step(k)
        places.append(arm.measure().pose[:3].copy())
        forces.append(felt.copy())
    return np.array(places), np.array(forces)


def _ours(servo: ServoArm, motion: Motion) -> Callable[[int], None]:
    loop = PositionLoop(servo)
    rates = np.gradient(motion.poses[:, :3], CYCLE, axis=0)

    def step(k: int) -> None:
        target = resting_target(motion.poses[k])
        target[TWIST:TWIST + 3] = rates[k]
        target[STIFFNESS:STIFFNESS + 36] = np.diag(motion.stiffness[k]).ravel()
        loop.must_follow(target)
        loop.tick()
    return step


def _peer(servo: ServoArm, motion: Motion, fixed: np.ndarray) -> Callable[[int], None]:
    # Its damping and mass are those of ours, so that both are as calm in contact.
    settings = AdmittanceSettings()
    linear = DAMPING_SHARE * settings.contact_stiffness * (FAST.delay + FAST.lag + 0.0005)
    levers = np.array([1.0] * 3 + [LEVER_M ** 2] * 3)
    peer = DiagonalAdmittance(servo, fixed, linear * levers, settings.virtual_mass * levers)
    return lambda k: peer.tick(motion.poses[k])


METHODS: dict[str, dict[str, np.ndarray | None]] = {
    'wiping': {'streamed': None, 'fixed, stiff': _diagonal(STIFF, STIFF),
               'fixed, soft': _diagonal(SOFT_NORMAL, SOFT_NORMAL),
               'fixed, soft along the normal': _diagonal(STIFF, SOFT_NORMAL)},
    'insertion': {'streamed': None, 'fixed, stiff': _diagonal(STIFF, STIFF),
                  'fixed, half': _diagonal(500.0, STIFF),
                  'fixed, soft aside': _diagonal(SOFT_ASIDE, STIFF)}}


def run(settings: TimingSettings) -> dict[str, Any]:
    """Both tasks, each at three places, with each method."""
    arm = Arm('ur5e')
    home = arm.pose_at(arm.home)
    document: dict[str, Any] = {}
    insert = insertion(home)
    for name, fixed in METHODS['wiping'].items():
        rows, wipe = [], wiping(home, SOFT_NORMAL if fixed is None else float(fixed[2]))
        for height in HEIGHTS:
            places, forces = follow(wipe, board(home[2] - 0.02 + height), fixed)
            rows.append([*_away(places, wipe), _rms(forces[wipe.touching, 2] - WANTED),
                         float((forces[wipe.touching, 2] <= 0.0).mean())])
        free, aside, off, lost = np.array(rows).T
        document.setdefault('wiping', {})[name] = {
            'free_m': _rms(free), 'aside_m': _rms(aside), 'force_off_n': _rms(off),
            'contact_lost': float(lost.mean())}
    for name, fixed in METHODS['insertion'].items():
        rows = []
        for x, y in PLACES:
            top = home[:3] + [x, ASIDE + y, -0.005]
            places, forces = follow(insert, hole(top), fixed)
            rows.append([_away(places, insert)[0],
                         float(places[-1, 2] < top[2] - 0.9 * DEEP),
                         float(np.linalg.norm(forces[insert.touching, :2], axis=1).max()),
                         float(np.linalg.norm(forces, axis=1).max())])
        free, inside, pressed, largest = np.array(rows).T
        document.setdefault('insertion', {})[name] = {
            'free_m': _rms(free), 'inserted': float(inside.mean()),
            'pressed_aside_n': float(pressed.max()), 'largest_force_n': float(largest.max())}
    return document


def _away(places: np.ndarray, motion: Motion) -> tuple[float, float]:
    """Distance from the motion, RMS [m]: where nothing is touched, and aside where it is."""
    off = places - motion.poses[:, :3]
    return (_rms(np.linalg.norm(off[motion.free], axis=1)),
            _rms(np.linalg.norm(off[motion.touching, :2], axis=1)))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Lines of the table, the first its head."""
    lines = [['task', 'stiffness', 'off in the air [mm]', 'off aside [mm]', 'force off [N]',
              'succeeds', 'largest force [N]']]
    for name, one in document['wiping'].items():
        lines.append(['wiping', name, f'{1e3 * one["free_m"]:.1f}', f'{1e3 * one["aside_m"]:.1f}',
                      f'{one["force_off_n"]:.1f}', f'{1.0 - one["contact_lost"]:.0%} in contact',
                      ''])
    for name, one in document['insertion'].items():
        lines.append(['insertion', name, f'{1e3 * one["free_m"]:.1f}', '',
                      f'{one["pressed_aside_n"]:.1f} aside', f'{one["inserted"]:.0%}',
                      f'{one["largest_force_n"]:.0f}'])
    return lines

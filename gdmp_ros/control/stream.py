"""
What the guard does with a stream of references that goes on, compiled.

Everything else, the beginning and the end of a motion and every refusal, is decided by
`gdmp_ros.control.guard`, which has the same memory.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gdmp_ros.control.arm_states import State
from gdmp_ros.control.joint_target import joints_of
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.reference_check import continues, is_invalid, is_invalid_for_joints
from gdmp_ros.control.target import (
    ACCELERATION,
    extrapolate_pose,
    POSE,
    STIFFNESS,
    TARGET_SIZE,
    TWIST,
    WRENCH,
)
from gdmp_ros.kernels import jitable, kernel, local_numbers, records_at
from gdmp_ros.manifolds.linalg import copy_into, norm
from gdmp_ros.manifolds.quaternion import normalize, pose_distance, rotation_between
from gdmp_ros.util.profiles import smoothstep

#: Time for which the acceleration of the last reference is used between two references [s].
ACCELERATION_S = 0.01
#: The usual delay of references is the mean of about so many, and of none before a gap [s].
DELAY_SHARE, DELAY_GAP_S = 0.02, 0.05
#: A reference that is further from its usual time is followed as it is [s].
LARGEST_SHIFT_S = 0.02

#: How far the poses of a stream may be from its twists: always [m, rad], for each unit of speed
#: [s], and as a share of the way between two references; how long that is remembered [s].
_APART, _APART_S, _APART_SHARE, _MEMORY_S = (0.001, 0.005), 0.001, 0.1, 0.1
#: Twists that were wrong are used again when they have been right for this time [s].
TRUSTED_S = 0.5
#: Twists are not compared with poses that are further apart in time [s].
_LONGEST_STEP_S = 0.1
#: What a stream did not go while it could is forgotten with this time constant [s].
_SPARE_S = 0.01

#: What a guard knows of its streams; flags are 0 or 1.
STREAM = np.dtype([(name, np.float64) for name in (
    'state',            # of the arm: its number in `State`
    'noted',            # flag: the guard knows it
    'of_joints',        # flag: the target is one of the joints
    # The newest reference that is followed.
    'fresh',            # flag: it has come in this tick
    'age',              # [s]
    'sequence',         # its number
    'delay',            # usual age of references on arrival [s]
    'resumable',        # flag: its stream may go on after a gap
    'arrived_age',      # its age on arrival [s]
    'stamp',            # [s]; 0 if it has none
    'way', 'turn',      # how far the next one may be from it, besides what time adds [m, rad]
    # The newest reference that came, followed or not.
    'offered_mode', 'offered_sequence', 'offered_age',
    'offered_of_joints',  # flag
    'offered_rests',    # flag: it was at rest, at a place that is kept
    'on_time',          # number of the last reference that was on time
    'armed',            # time for which a motion is followed wherever it is [s]
    'stop_progress',    # of coming to rest, 1 at rest
    # Settings.
    'stop_time',        # [s]
    'timeout', 'stamp_tolerance', 'jump_position', 'jump_rotation', 'jump_joints',
    'fastest', 'fastest_turn')])  # how fast references may go on [m/s, rad/s]
_SCALARS = len(STREAM.names or ())
_FIXED = _SCALARS + 21 + 6 + TARGET_SIZE - WRENCH


class Newest(NamedTuple):
    """
    What follows a `STREAM` record: of the newest reference that is followed, as it came.

    :ivar place: its pose
    :ivar twist: [m/s, rad/s]
    :ivar apart: how far the poses of the stream are from its twists [m, rad]
    :ivar distrusted: time until its twists are used again, the linear and the angular ones [s]
    :ivar stopped: twist of the target when it began to come to rest, and all from its wrench on
    :ivar stopped_joints: velocities of the joints, when their target did [rad/s]
    """

    place: np.ndarray
    twist: np.ndarray
    apart: np.ndarray
    distrusted: np.ndarray
    stopped: np.ndarray
    stopped_joints: np.ndarray


@jitable
def newest(numbers):
    """See `Newest`."""
    return Newest(numbers[_SCALARS:_SCALARS + 7], numbers[_SCALARS + 7:_SCALARS + 13],
                  numbers[_SCALARS + 13:_SCALARS + 19], numbers[_SCALARS + 19:_SCALARS + 21],
                  numbers[_SCALARS + 21:_FIXED], numbers[_FIXED:])


#: What `go_on` has done with a reference.
FOLLOWED, REMEMBERED, OTHER = range(3)
_NUMBERS = {state: number for number, state in enumerate(State)}
_HOLDING, _RESTING, _FOLLOWING, _STOPPING, _GUIDED, _COMPLIANT = (
    _NUMBERS[state] for state in (State.HOLDING, State.RESTING, State.FOLLOWING, State.STOPPING,
                                  State.GUIDED, State.COMPLIANT))
#: Joint damping of an arm that a hand moves [Nm s/rad]: it comes to rest when the hand lets go.
_GUIDED_DAMPING, _COMPLIANT_DAMPING = 2.0, 5.0
_MOTION, _REST = int(StreamMode.STREAMING), int(StreamMode.HOLDING)


def number_of(state: State) -> int:
    """Number of a state, as kernels know it."""
    return _NUMBERS[state]


@kernel
def extrapolate(target, dt, age):
    """
    Move a target of the tool on.

    :param age: of the reference that it came with [s]
    """
    for i in range(6):
        if age <= ACCELERATION_S:
            target[TWIST + i] += dt * target[ACCELERATION + i]
        else:
            target[ACCELERATION + i] = 0.0
    extrapolate_pose(target, dt, target[POSE:POSE + 7])


@kernel
def extrapolate_joints(target, dt):
    """Move a target of the joints on."""
    n = joints_of(target)
    for i in range(n):
        target[i] += dt * target[n + i]


@kernel
def remember(numbers, mode, sequence, of_joints):
    """Keep what came, followed or not."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    stream.offered_mode, stream.offered_sequence = mode, sequence
    stream.offered_age, stream.offered_of_joints = 0.0, of_joints
    stream.offered_rests = 1.0 if mode == _REST else 0.0


@kernel
def allowance(numbers):
    """
    How far the next reference may be from the last one, whatever its twist says [m, rad].

    What an arm could travel since then, and one jump. After a gap the ones that were late arrive
    together: what was not used of a gap is kept for some milliseconds.
    """
    stream = records_at(numbers, 0, 1, STREAM)[0]
    kept = math.exp(-stream.age / _SPARE_S)
    way = min(stream.way, stream.jump_position)
    turn = min(stream.turn, stream.jump_rotation)
    return (way + kept * (stream.way - way) + stream.fastest * stream.age,
            turn + kept * (stream.turn - turn) + stream.fastest_turn * stream.age)


@kernel
def _compare(last, target, step):
    """Find out whether twists are those of the poses; ``step`` is the time in between [s]."""
    if not 0.0 < step <= _LONGEST_STEP_S:
        last.apart[:] = 0.0
        return
    moved, kept = local_numbers(6), math.exp(-step / _MEMORY_S)
    for i in range(3):
        moved[i] = target[POSE + i] - last.place[i]
    rotation_between(last.place[3:], target[POSE + 3:POSE + 7], moved[3:])
    for part in range(2):
        first = 3 * part
        for i in range(first, first + 3):
            last.apart[i] = (kept * last.apart[i] + moved[i]
                             - 0.5 * step * (last.twist[i] + target[TWIST + i]))
        speed = max(norm(3, last.twist[first:first + 3]),
                    norm(3, target[TWIST + first:TWIST + first + 3]))
        allowed = _APART[part] + (_APART_S + _APART_SHARE * step) * speed
        if norm(3, last.apart[first:first + 3]) > allowed:
            last.distrusted[part] = TRUSTED_S
        else:
            last.distrusted[part] -= step


@kernel
def _arrive(numbers, target, age, stamp, begins):
    """
    A reference is followed: know it as it came.

    Stamps say how much later it is than the last one: an arm that lost ticks does not know it.
    """
    stream, last = records_at(numbers, 0, 1, STREAM)[0], newest(numbers)
    if begins:
        stream.way, stream.turn = stream.jump_position, stream.jump_rotation
        last.apart[:], last.distrusted[:] = 0.0, 0.0
    else:
        distance, angle = pose_distance(last.place, target[POSE:POSE + 7])
        way, turn = allowance(numbers)
        stream.way, stream.turn = way - distance, turn - angle
        known = stamp != 0.0 and stream.stamp != 0.0
        _compare(last, target, stamp - stream.stamp if known
                 else stream.age + stream.arrived_age - age)
    stream.arrived_age, stream.stamp = age, stamp
    for i in range(7):
        last.place[i] = target[POSE + i]
    for i in range(6):
        last.twist[i] = target[TWIST + i]


@kernel
def use(numbers, last, target, age, stamp, sequence, begins):
    """
    Follow a reference; one that is later, or earlier, than usual is moved in time.

    Otherwise one that was delayed by a millisecond would be a step of the motion.

    :param last: target that is followed, changed
    :param age: of the reference on arrival [s]
    :param stamp: [s]; 0 if it has none
    :param begins: whether nothing was followed before
    """
    stream = records_at(numbers, 0, 1, STREAM)[0]
    copy_into(target, last)
    if stream.of_joints == 0.0:
        _arrive(numbers, target, age, stamp, begins)
        distrusted = newest(numbers).distrusted
        for part in range(2):
            if distrusted[part] > 0.0:
                first = TWIST + 3 * part
                last[first:first + 3] = 0.0
                last[first + ACCELERATION - TWIST:first + ACCELERATION - TWIST + 3] = 0.0
    if begins or stream.age > DELAY_GAP_S:
        stream.delay = age
    shift = age - stream.delay
    stream.delay += DELAY_SHARE * shift
    if abs(shift) > LARGEST_SHIFT_S:
        shift = 0.0
    if shift != 0.0:
        if stream.of_joints == 0.0:
            extrapolate(last, shift, 0.0)
        else:
            extrapolate_joints(last, shift)
    stream.fresh = stream.resumable = 1.0
    stream.armed, stream.age, stream.sequence = 0.0, 0.0, sequence


@kernel
def _jumps(numbers, last, target):
    """Whether a reference is too far from the last one of its stream."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    if stream.of_joints != 0.0:
        for i in range(joints_of(target)):
            if not abs(target[i] - last[i]) <= stream.jump_joints:
                return True
        return False
    distance, angle = pose_distance(newest(numbers).place, target[POSE:POSE + 7])
    way, turn = allowance(numbers)
    return not (distance <= way and angle <= turn)


@kernel
def go_on(numbers, last, held, target, age, stamp, sequence, mode):
    """
    Follow a reference that continues its stream, or remember one that rests.

    :param numbers: a `STREAM` record
    :param last: target of the tool, or of the joints, changed if it is followed
    :param held: written: where a reference that rests is (x, y, z, qw, qx, qy, qz), or its joints
    :param target: `TARGET_SIZE` numbers in the frame of the arm, or those of
        `gdmp_ros.control.joint_target`; a quaternion is normalised
    :param age: present time minus its stamp [s]
    :param stamp: [s]; 0 if it has none
    :returns: `FOLLOWED`, `REMEMBERED`, or `OTHER`: then nothing was done, and it is to be decided
    """
    stream, of_joints = records_at(numbers, 0, 1, STREAM)[0], target.size != TARGET_SIZE
    follows = (stream.state == _FOLLOWING and mode == _MOTION
               or stream.state == _RESTING and mode == _REST)
    # Where nothing is followed, a stream that rests asks for nothing.
    waits = mode == _REST and (stream.state == _HOLDING and stream.resumable == 0.0
                               or stream.state >= _GUIDED)
    if not (follows or waits) or follows and (stream.of_joints != 0.0) != of_joints:
        return OTHER
    if not abs(age) <= stream.stamp_tolerance or target.size != last.size:
        return OTHER
    if is_invalid_for_joints(target) if of_joints else is_invalid(target):
        return OTHER
    if not of_joints:
        normalize(target[POSE + 3:POSE + 7])
    if follows and (not continues(sequence, stream.sequence) or _jumps(numbers, last, target)):
        return OTHER
    stream.on_time = sequence
    remember(numbers, mode, sequence, 1.0 if of_joints else 0.0)
    if mode == _REST:
        for i in range(joints_of(target) if of_joints else 7):
            held[i] = target[i]
    if follows:
        use(numbers, last, target, age, stamp, sequence, False)
    return FOLLOWED if follows else REMEMBERED


@kernel
def is_followed(numbers):
    """Whether references are followed."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    return stream.state == _FOLLOWING or stream.state == _RESTING


@kernel
def is_lost(numbers):
    """Whether the newest reference is too old."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    return stream.age > stream.timeout + 1e-9


@kernel
def has_changed(numbers):
    """Whether a motion that was followed is lost, or has come to rest after a stop."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    return stream.state == _STOPPING and (stream.noted == 0.0 or stream.stop_progress >= 1.0)


@kernel
def free_damping(numbers):
    """Damping of the joints of an arm that a hand moves [Nm s/rad]; 0 for any other."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    if stream.state == _GUIDED:
        return _GUIDED_DAMPING
    return _COMPLIANT_DAMPING if stream.state == _COMPLIANT else 0.0


@kernel
def elapse(numbers, dt):
    """Let time pass [s]."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    stream.offered_age += dt
    stream.armed -= dt


@kernel
def advance(numbers, tool, joints, dt):
    """
    Move the target on, if no reference came for this tick, or let it come to rest.

    What is lost begins to stop; the guard finds that out (`ReferenceGuard.settle`).

    :param tool: target of the tool
    :param joints: target of the joints
    """
    stream = records_at(numbers, 0, 1, STREAM)[0]
    if is_followed(numbers) and is_lost(numbers):
        stream.state, stream.noted = _STOPPING, 0.0
        begin_stop(numbers, tool, joints)
    if not is_followed(numbers):
        _slow_down(numbers, tool, joints, dt)
    elif stream.fresh == 0.0:
        if stream.of_joints == 0.0:
            extrapolate(tool, dt, stream.age)
        else:
            extrapolate_joints(joints, dt)
    stream.fresh = 0.0
    stream.age += dt


@kernel
def begin_stop(numbers, tool, joints):
    """Let the target come to rest from now on; see `advance`."""
    stream, known = records_at(numbers, 0, 1, STREAM)[0], newest(numbers)
    stream.stop_progress = stream.resumable = 0.0
    if stream.of_joints != 0.0:
        n = joints_of(joints)
        copy_into(joints[n:2 * n], known.stopped_joints)
        return
    for i in range(6):
        known.stopped[i] = tool[TWIST + i]
    for i in range(WRENCH, TARGET_SIZE):
        known.stopped[6 + i - WRENCH] = tool[i]


@kernel
def _slow_down(numbers, tool, joints, dt):
    """Reduce the velocity and the wrench of a target that comes to rest."""
    stream, known = records_at(numbers, 0, 1, STREAM)[0], newest(numbers)
    if stream.stop_progress >= 1.0:
        return
    stream.stop_progress = min(1.0, stream.stop_progress + dt / stream.stop_time)
    left = 1.0 - smoothstep(stream.stop_progress)
    if stream.of_joints != 0.0:
        n = joints_of(joints)
        for i in range(n):
            joints[n + i] = left * known.stopped_joints[i]
        extrapolate_joints(joints, dt)
        return
    for i in range(6):
        tool[TWIST + i] = left * known.stopped[i]
    for i in range(WRENCH, TARGET_SIZE):
        tool[i] = left * known.stopped[6 + i - WRENCH]
    extrapolate(tool, dt, math.inf)


@kernel
def rest_at(numbers, tool, pose):
    """
    Follow nothing but a target of the tool that rests; its stiffness stays.

    :param pose: of the tool (x, y, z, qw, qx, qy, qz)
    """
    records_at(numbers, 0, 1, STREAM)[0].of_joints = 0.0
    tool[:STIFFNESS] = 0.0
    tool[WRENCH:] = 0.0
    copy_into(pose, tool[POSE:POSE + 7])


def blank(joints: int) -> np.ndarray:
    """A `STREAM` record, and what follows it, of a guard that has seen nothing."""
    return np.zeros(_FIXED + joints)

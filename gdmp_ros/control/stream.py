"""
What the guard does with a stream of references that goes on, compiled.

Everything else, the beginning and the end of a motion and every refusal, is decided by
`gdmp_ros.control.guard`, which has the same memory.
"""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.arm_states import State
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.reference_check import continues, is_invalid
from gdmp_ros.control.target import ACCELERATION, extrapolate_pose, POSE, TWIST
from gdmp_ros.kernels import kernel, records_at
from gdmp_ros.manifolds.quaternion import normalize, pose_distance

#: Time for which the acceleration of the last reference is used between two references [s].
ACCELERATION_S = 0.01
#: The usual delay of references is the mean of about so many, and of none before a gap [s].
DELAY_SHARE, DELAY_GAP_S = 0.02, 0.05
#: A reference that is further from its usual time is followed as it is [s].
LARGEST_SHIFT_S = 0.02

#: What a guard knows of its streams; flags are 0 or 1.
STREAM = np.dtype([(name, np.float64) for name in (
    'state',            # of the arm: its number in `State`
    'of_joints',        # flag: the target is one of the joints
    # The newest reference that is followed.
    'fresh',            # flag: it has come in this tick
    'age',              # [s]
    'sequence',         # its number
    'delay',            # usual age of references on arrival [s]
    'resumable',        # flag: its stream may go on after a gap
    # The newest reference that came, followed or not.
    'offered_mode', 'offered_sequence', 'offered_age',
    'offered_of_joints',  # flag
    'offered_rests',    # flag: it was at rest, at a place that is kept
    'on_time',          # number of the last reference that was on time
    'armed',            # time for which a motion is followed wherever it is [s]
    'stop_progress',    # of coming to rest, 1 at rest
    # Settings.
    'timeout', 'stamp_tolerance', 'jump_position', 'jump_rotation')])
#: What `go_on` has done with a reference.
FOLLOWED, REMEMBERED, OTHER = range(3)
_NUMBERS = {state: number for number, state in enumerate(State)}
_HOLDING, _RESTING, _FOLLOWING = (
    _NUMBERS[state] for state in (State.HOLDING, State.RESTING, State.FOLLOWING))
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
def remember(numbers, mode, sequence, of_joints):
    """Keep what came, followed or not."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    stream.offered_mode, stream.offered_sequence = mode, sequence
    stream.offered_age, stream.offered_of_joints = 0.0, of_joints
    stream.offered_rests = 1.0 if mode == _REST else 0.0


@kernel
def use(numbers, last, target, age, sequence, begins):
    """
    Follow a reference; one of the tool that is later, or earlier, than usual is moved in time.

    Otherwise one that was delayed by a millisecond would be a step of the motion.

    :param last: target that is followed, changed
    :param age: of the reference on arrival [s]
    :param begins: whether nothing was followed before
    :returns: by how much it is to be moved in time [s]; one of the joints is not moved here
    """
    stream = records_at(numbers, 0, 1, STREAM)[0]
    last[:] = target
    if begins or stream.age > DELAY_GAP_S:
        stream.delay = age
    shift = age - stream.delay
    stream.delay += DELAY_SHARE * shift
    if abs(shift) > LARGEST_SHIFT_S:
        shift = 0.0
    if stream.of_joints == 0.0 and shift != 0.0:
        extrapolate(last, shift, 0.0)
    stream.fresh = stream.resumable = 1.0
    stream.armed, stream.age, stream.sequence = 0.0, 0.0, sequence
    return shift


@kernel
def go_on(numbers, last, held, target, age, sequence, mode):
    """
    Follow a reference of the tool that continues its stream, or remember one that rests.

    :param numbers: a `STREAM` record
    :param last: target that is followed, changed
    :param held: written: where a reference that rests is (x, y, z, qw, qx, qy, qz)
    :param target: `TARGET_SIZE` numbers in the frame of the arm; its quaternion is normalised
    :param age: present time minus its stamp [s]
    :returns: `FOLLOWED`, `REMEMBERED`, or `OTHER`: then nothing was done, and it is to be decided
    """
    stream = records_at(numbers, 0, 1, STREAM)[0]
    follows = (stream.state == _FOLLOWING and mode == _MOTION
               or stream.state == _RESTING and mode == _REST)
    waits = stream.state == _HOLDING and mode == _REST and stream.resumable == 0.0
    if not (follows or waits) or stream.of_joints != 0.0:
        return OTHER
    if not abs(age) <= stream.stamp_tolerance or is_invalid(target):
        return OTHER
    normalize(target[POSE + 3:POSE + 7])
    if follows:
        if not continues(sequence, stream.sequence):
            return OTHER
        distance, angle = pose_distance(last[POSE:POSE + 7], target[POSE:POSE + 7])
        if not (distance <= stream.jump_position and angle <= stream.jump_rotation):
            return OTHER
    stream.on_time = sequence
    remember(numbers, mode, sequence, 0.0)
    if mode == _REST:
        for i in range(7):
            held[i] = target[POSE + i]
    if follows:
        use(numbers, last, target, age, sequence, False)
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
def is_plain(numbers):
    """Whether the next tick neither ends the stream nor slows down, and is of the tool."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    if stream.of_joints != 0.0:
        return False
    if stream.state == _HOLDING:
        return stream.stop_progress >= 1.0
    return is_followed(numbers) and not is_lost(numbers)


@kernel
def elapse(numbers, dt):
    """Let time pass [s]."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    stream.offered_age += dt
    stream.armed -= dt


@kernel
def advance(numbers, target, dt):
    """Move the target of the tool on, if no reference came for this tick."""
    stream = records_at(numbers, 0, 1, STREAM)[0]
    if stream.fresh == 0.0 and stream.of_joints == 0.0 and is_followed(numbers):
        extrapolate(target, dt, stream.age)
    stream.fresh = 0.0
    stream.age += dt


def blank() -> np.ndarray:
    """A `STREAM` record of a guard that has seen nothing."""
    return np.zeros(len(STREAM.names or ()))

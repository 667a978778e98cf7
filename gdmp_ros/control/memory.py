"""
Layout of the memory of an arm's controller: one flat array, cut into named parts.

One array makes a call of the compiled tick cheap, and holds all that the tick knows of the past.
The memory begins with a record of sizes; the parts follow in the order in which `arm_view` cuts
them. Python and kernels see the same parts.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.own_body import CAPSULE_SIZE
from gdmp_ros.control.settings import GAIN_NUMBERS, LIMIT_NUMBERS, TANK_NUMBERS
from gdmp_ros.control.target import TARGET_SIZE
from gdmp_ros.kernels import inlined, matrix_at, records_at, vector_at
from gdmp_ros.scene.volume import CAPACITY, VOLUME_SIZE

#: What a tick does: a spring at the tool, springs at the joints, damping alone, a joint motion.
TOOL_SPRING, JOINT_SPRINGS, FREE, JOINT_MOTION = range(4)
#: Torques that may still be on their way to the motors.
MOST_TORQUES = 24

SIZES = np.dtype([(name, np.int64) for name in ('joints', 'capsules', 'pairs')])

#: The scalars of a controller; flags are 0 or 1.
SCALARS = np.dtype([(name, np.float64) for name in (
    'dt',                # time for which the torque acts [s]
    'cycle',             # longest time that counts for the rate of the torque [s]
    'does',              # what this tick does: `TOOL_SPRING` …
    'law',               # the spring that holds energy: `TOOL_SPRING` or `JOINT_SPRINGS`
    'potential',         # measured, of gravity [J]
    'free_damping',      # of joints that a hand moves [Nm s/rad]
    'free_friction',     # at the tool of an arm that a hand moves [N]
    'damping_ratio',     # setting, of references that have none
    'torques',           # how many torques of the past are known
    # Energy tank.
    'energy',            # content [J]
    'coriolis',          # energy of the Coriolis forces in a tick, smoothed [J]
    'known',             # flag: the state at the last torque is known
    'potential_before', 'stored_before',  # at the last torque [J]
    # Contact.
    'collision_force', 'collision_torque', 'feedback_force', 'feedback_torque',  # settings
    'unknown',           # time since when the external wrench is not finite [s]
    'against',           # what opposes the motion in a collision [N, Nm]
    # What the tick has found.
    'stored',            # energy in the spring at its end [J]
    'way',               # share of the asked velocity that the governed reference has, a mean
    'blocked',           # time for which the governed reference has made no way [s]
    'blocking',          # the limit that keeps it: index of `gdmp_ros.control.limit_rows`, or -1
    'returns',           # flag: its joints go straight to the posture, where the target is
    'seen',              # how long ago the volumes around it were seen [s]
    'clearance',         # least distance of a link of the reference from a volume [m]
    'nearest',           # which: volume times capsules plus capsule, or -1
    'slowed',            # share of the speed that is left beside volumes that come
    'left',              # the same, where the arm was measured in the last tick
    'share',             # of its speed, that a motion of the joints has
    'permitted', 'allowed')])  # 0: references make no way; and the share of the speed meanwhile
_SIZES, _SCALARS, _TANK = (dtype.itemsize // 8 for dtype in (SIZES, SCALARS, TANK_NUMBERS))
_GAINS, _LIMITS = GAIN_NUMBERS.itemsize // 8, LIMIT_NUMBERS.itemsize // 8
_LIMIT_COUNT = len(LIMITS)


class ArmMemory(NamedTuple):
    """
    The parts of a controller's memory; n is the number of joints.

    :ivar gains: `ImpedanceGains` as numbers
    :ivar limits: `LimitSettings` as numbers
    :ivar bounds: of the stiffness at the tool, shape (2, 36)
    :ivar pose: measured, of the tool (x, y, z, qw, qx, qy, qz)
    :ivar acceleration: measured, of the tool at constant joint velocity, J̇ q̇
    :ivar jacobian: measured, shape (6, n)
    :ivar inertia: measured, shape (n, n)
    :ivar target: of the guard, `TARGET_SIZE` numbers
    :ivar reference: the governed one of the tool
    :ivar past: its mean acceleration, its last one and its twist, as far as limits of joints and
        tool do not change them, shape (3, 6)
    :ivar frames: of the joints of the arm (`gdmp_ros.control.kinematics.Chain`)
    :ivar axes: the same
    :ivar end: pose of the tool in the frame of the last joint
    :ivar moments: of weight that the model lacks (`gdmp_ros.control.weight`) [Nm], shape (n, 3)
    :ivar wanted_moments: what they approach
    :ivar capsules: of its body (`gdmp_ros.control.own_body.Body`)
    :ivar pairs: the same
    :ivar nearness: of pairs inside the distance that they keep which does not act yet [m]
    :ivar volumes: around the arm, packed (`gdmp_ros.scene.volume`), shape (`CAPACITY`, ...)
    :ivar depth: of links inside the margin of volumes that does not act [m], shape (`CAPACITY`, m)
    :ivar joint_target: of the guard, 3 n + 1 numbers
    :ivar joint_reference: the governed one of the joints
    :ivar joint_limits: lower, upper [rad], largest speed of a reference [rad/s], and how the robot
        slows its joints down (`gdmp_ros.control.measurement.JointLimits`), shape (5, n)
    :ivar friction: that is compensated, viscous [Nm s/rad] and dry [Nm], shape (2, n)
    :ivar credit: that is there for certain (`gdmp_ros.control.friction.friction_of`), shape (4, n)
    :ivar sent: torques that may act now, the last one first [Nm], shape (`MOST_TORQUES`, n)
    :ivar position: measured [rad], shape (n,), as all that follow
    :ivar velocity: measured [rad/s]
    :ivar bias: gravity and Coriolis torque [Nm]
    :ivar external: torque of the environment [Nm]
    :ivar posture: that the null space approaches [rad]; it goes to the next one, `wanted_posture`
    :ivar wanted_posture: the same
    :ivar wanted: positions of a joint motion [rad]
    :ivar wanted_rate: their velocities [rad/s]
    :ivar joint_mean: acceleration of the reference of the joints, smoothed [rad/s²]
    :ivar push: torque that comes before that of the law: walls, own body [Nm]
    :ivar largest: torque limits [Nm]
    :ivar fastest: speed limits [rad/s]
    :ivar velocity_before: at the last torque
    :ivar bias_before: the same
    :ivar last: torque of the last tick [Nm]
    :ivar torque: of this tick [Nm]
    :ivar governed: of the governed reference of the tool: it is where these have the tool [rad]
    :ivar governed_rate: their velocities [rad/s]
    :ivar rates: velocities of what the joints follow: of the last tick, and from its end of this
    :ivar relief: depth in the zone of repulsion of a joint that does not act yet [rad]
    :ivar outside: distance of the tool beyond a wall of the workspace that does not act yet [m],
        shape (3,)
    :ivar felt: smoothed external wrench, acting on the tool [N, Nm]
    :ivar correction: of the wrench of a reference
    :ivar twist: measured, of the tool
    :ivar wrench: external, at the tool
    :ivar commanded: wrench of the law at the tool
    :ivar violation: by how much each limit was exceeded in this tick
    :ivar counts: ticks in which each limit was exceeded
    :ivar recent: largest violations since the last report
    """

    scalars: Any
    tank: Any
    gains: Any
    limits: Any
    bounds: Any
    pose: Any
    acceleration: Any
    jacobian: Any
    inertia: Any
    target: Any
    reference: Any
    past: Any
    frames: Any
    axes: Any
    end: Any
    moments: Any
    wanted_moments: Any
    capsules: Any
    pairs: Any
    nearness: Any
    volumes: Any
    depth: Any
    joint_target: Any
    joint_reference: Any
    joint_limits: Any
    friction: Any
    credit: Any
    sent: Any
    position: Any
    velocity: Any
    bias: Any
    external: Any
    posture: Any
    wanted_posture: Any
    wanted: Any
    wanted_rate: Any
    joint_mean: Any
    push: Any
    largest: Any
    fastest: Any
    velocity_before: Any
    bias_before: Any
    last: Any
    torque: Any
    governed: Any
    governed_rate: Any
    rates: Any
    relief: Any
    outside: Any
    felt: Any
    correction: Any
    twist: Any
    wrench: Any
    commanded: Any
    violation: Any
    counts: Any
    recent: Any


@inlined
def arm_view(memory):
    """Cut a memory into its parts."""
    sizes = records_at(memory, 0, 1, SIZES)[0]
    n, capsule_count, pair_count = sizes.joints, sizes.capsules, sizes.pairs
    scalars = records_at(memory, _SIZES, 1, SCALARS)[0]
    at = _SIZES + _SCALARS
    tank = records_at(memory, at, 1, TANK_NUMBERS)[0]
    at += _TANK
    gains, limits = vector_at(memory, at, _GAINS), vector_at(memory, at + _GAINS, _LIMITS)
    at += _GAINS + _LIMITS
    bounds = matrix_at(memory, at, 2, 36)
    pose, acceleration = vector_at(memory, at + 72, 7), vector_at(memory, at + 79, 6)
    at += 85
    jacobian = matrix_at(memory, at, 6, n)
    at += 6 * n
    inertia = matrix_at(memory, at, n, n)
    at += n * n
    target = vector_at(memory, at, TARGET_SIZE)
    reference = vector_at(memory, at + TARGET_SIZE, TARGET_SIZE)
    at += 2 * TARGET_SIZE
    past = matrix_at(memory, at, 3, 6)
    at += 18
    frames = matrix_at(memory, at, n, 7)
    axes = matrix_at(memory, at + 7 * n, n, 3)
    end = vector_at(memory, at + 10 * n, 7)
    at += 10 * n + 7
    moments, wanted_moments = matrix_at(memory, at, n, 3), matrix_at(memory, at + 3 * n, n, 3)
    at += 6 * n
    capsules = matrix_at(memory, at, capsule_count, CAPSULE_SIZE)
    at += CAPSULE_SIZE * capsule_count
    pairs = matrix_at(memory, at, pair_count, 2)
    nearness = vector_at(memory, at + 2 * pair_count, pair_count)
    at += 3 * pair_count
    volumes = matrix_at(memory, at, CAPACITY, VOLUME_SIZE)
    at += CAPACITY * VOLUME_SIZE
    depth = matrix_at(memory, at, CAPACITY, capsule_count)
    at += CAPACITY * capsule_count
    size = 3 * n + 1
    joint_target = vector_at(memory, at, size)
    joint_reference = vector_at(memory, at + size, size)
    at += 2 * size
    joint_limits = matrix_at(memory, at, 5, n)
    friction = matrix_at(memory, at + 5 * n, 2, n)
    credit = matrix_at(memory, at + 7 * n, 4, n)
    at += 11 * n
    sent = matrix_at(memory, at, MOST_TORQUES, n)
    at += MOST_TORQUES * n
    joints = matrix_at(memory, at, 20, n)
    at += 20 * n
    tool, outside = matrix_at(memory, at, 5, 6), vector_at(memory, at + 30, 3)
    at += 33
    limited = matrix_at(memory, at, 3, _LIMIT_COUNT)
    return ArmMemory(
        scalars, tank, gains, limits, bounds, pose, acceleration, jacobian, inertia, target,
        reference, past, frames, axes, end, moments, wanted_moments, capsules, pairs, nearness,
        volumes, depth, joint_target, joint_reference, joint_limits, friction, credit, sent,
        joints[0], joints[1], joints[2], joints[3], joints[4], joints[5], joints[6], joints[7],
        joints[8], joints[9], joints[10], joints[11], joints[12], joints[13], joints[14],
        joints[15], joints[16], joints[17], joints[18], joints[19], outside,
        tool[0], tool[1], tool[2], tool[3], tool[4], limited[0], limited[1], limited[2])


def blank(joints: int, capsules: int = 0, pairs: int = 0) -> np.ndarray:
    """Memory of the controller of an arm; everything but the sizes is zero."""
    total = (_SIZES + _SCALARS + _TANK + _GAINS + _LIMITS + 85 + 6 * joints + joints * joints
             + 2 * TARGET_SIZE + 18 + 16 * joints + 7 + CAPSULE_SIZE * capsules + 3 * pairs
             + CAPACITY * (VOLUME_SIZE + capsules)
             + 2 * (3 * joints + 1) + (11 + MOST_TORQUES + 20) * joints + 33 + 3 * _LIMIT_COUNT)
    memory = np.zeros(total)
    memory[:_SIZES].view(SIZES)[0] = (joints, capsules, pairs)
    return memory


def parts(memory: np.ndarray) -> ArmMemory:
    """Cut a memory into its parts, in Python."""
    view: Any = arm_view
    result: ArmMemory = view.py_func(memory)
    return result

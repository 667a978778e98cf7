"""Messages as numbers, and numbers as messages."""
from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from gdmp_msgs.msg import JointReference, Reference, RobotState, Tube
from geometry_msgs.msg import (
    Pose,
    PoseStamped,
    PoseWithCovariance,
    Transform,
    TransformStamped,
    WrenchStamped,
)
from nav_msgs.msg import Path
import numpy as np
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from gdmp_ros.control.joint_target import joints_of
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.reference_check import LARGEST_NUMBER, Origin, QUATERNION_TOLERANCE
from gdmp_ros.control.target import (
    ACCELERATION,
    DAMPING_RATIO,
    POSE,
    STIFFNESS,
    TWIST,
    whole_target,
    WRENCH,
    WRENCH_GAIN,
)
from gdmp_ros.data import bags
from gdmp_ros.errors import ManifoldError
from gdmp_ros.realtime.statistics import Punctuality

NS = 1_000_000_000
#: Numbers of a robot state before those of its joints.
ROBOT_STATE_FIXED = 99 + len(RobotState().limited)
#: Entries of the diagnostics of a Franka.
IN_TIME, LOST, CPU_TIME = ('commands in time', 'cycles lost',
                           'CPU time of a cycle, 50 % and 99 % [us]')
_UNUSED = np.zeros(ROBOT_STATE_FIXED - 99 - len(LIMITS))


def pose_numbers(pose: Pose) -> np.ndarray:
    """(x, y, z, qw, qx, qy, qz) of a pose message."""
    return np.array(bags.pose_numbers(pose))


def pose_message(numbers: np.ndarray) -> Pose:
    """Pose of (x, y, z, qw, qx, qy, qz)."""
    result = Pose()
    set_pose(result, numbers)
    return result


def stamped_pose(numbers: np.ndarray, frame: str, stamp: Time | None = None) -> PoseStamped:
    """Pose of (x, y, z, qw, qx, qy, qz) in a frame; without a stamp it holds as it arrives."""
    result = PoseStamped(pose=pose_message(numbers))
    result.header.frame_id = frame
    if stamp is not None:
        result.header.stamp = stamp
    return result


def stamped_transform(parent: str, child: str, numbers: np.ndarray, stamp: Time | None = None
                      ) -> TransformStamped:
    """Pose (x, y, z, qw, qx, qy, qz) of a child in its parent; without a stamp it always holds."""
    result = TransformStamped(child_frame_id=child)
    result.header.frame_id = parent
    if stamp is not None:
        result.header.stamp = stamp
    set_transform(result.transform, numbers)
    return result


def set_pose(pose: Pose, numbers: np.ndarray) -> None:
    """Write (x, y, z, qw, qx, qy, qz) to a pose message."""
    p, q = pose.position, pose.orientation
    p.x, p.y, p.z, q.w, q.x, q.y, q.z = (float(v) for v in numbers[:7])


def set_vectors(first: Any, second: Any, numbers: np.ndarray) -> None:
    """Write six numbers to two vectors, as of a twist or a wrench."""
    first.x, first.y, first.z, second.x, second.y, second.z = (float(v) for v in numbers)


def stamp_of(ns: int) -> Time:
    """Time message of nanoseconds."""
    return Time(sec=ns // NS, nanosec=ns % NS)


def origin_of(message: Reference, age: float) -> Origin:
    """
    Where a reference comes from.

    :param age: present time minus its stamp [s]
    """
    stamp = message.header.stamp
    return Origin(message.header.frame_id, age, message.sequence, message.mode,
                  stamp.sec + 1e-9 * stamp.nanosec)


def fill_reference(message: Reference, numbers: np.ndarray) -> None:
    """Write the numbers of a target to a reference (see `bags.reference_target`)."""
    numbers = whole_target(numbers)
    set_pose(message.pose, numbers[POSE:])
    set_vectors(message.twist.linear, message.twist.angular, numbers[TWIST:TWIST + 6])
    set_vectors(message.acceleration.linear, message.acceleration.angular,
                numbers[ACCELERATION:ACCELERATION + 6])
    message.stiffness = numbers[STIFFNESS:DAMPING_RATIO]
    message.damping_ratio = float(numbers[DAMPING_RATIO])
    set_vectors(message.wrench.force, message.wrench.torque, numbers[WRENCH:WRENCH_GAIN])
    message.wrench_gain = numbers[WRENCH_GAIN:]


def fill_joint_reference(message: Any, numbers: np.ndarray) -> None:
    """Write a target of the joints (`gdmp_ros.control.joint_target`) to a reference."""
    n = joints_of(numbers)
    message.joints = [_joint_reference(numbers)]
    message.damping_ratio = float(numbers[3 * n])


def _joint_reference(numbers: np.ndarray) -> JointReference:
    n = joints_of(numbers)
    return JointReference(**{name: numbers[k * n:(k + 1) * n].tolist()
                             for k, name in enumerate(('position', 'velocity', 'stiffness'))})


def robot_state_numbers(tick: Tick) -> np.ndarray:
    """Numbers of a tick as `fill_robot_state` takes them."""
    measured = tick.measurement
    return np.concatenate([measured.pose, tick.twist, tick.wrench, tick.stiffness, tick.requested,
                           [tick.spring, tick.tank], tick.commanded, tick.violation, _UNUSED,
                           measured.position, measured.velocity, tick.torque,
                           () if tick.joints is None else tick.joints[:-1]])


def fill_robot_state(message: RobotState, numbers: np.ndarray, rows: int = 3) -> None:
    """
    Write the numbers of a tick (`robot_state_numbers`).

    :param rows: of numbers for each joint: 3, or 6 with a reference of the joints
    """
    set_pose(message.pose, numbers)
    set_vectors(message.twist.linear, message.twist.angular, numbers[7:13])
    set_vectors(message.wrench.force, message.wrench.torque, numbers[13:19])
    message.stiffness, message.requested_stiffness = numbers[19:55], numbers[55:91]
    message.spring_energy, message.tank_energy = float(numbers[91]), float(numbers[92])
    set_vectors(message.commanded_wrench.force, message.commanded_wrench.torque, numbers[93:99])
    message.limited = numbers[99:ROBOT_STATE_FIXED]
    fields = ('position', 'velocity', 'torque')
    joints = numbers[ROBOT_STATE_FIXED:].reshape(rows, -1)
    for name, row in zip(fields, joints):
        setattr(message, name, list(row))
    if rows > len(fields):
        message.joint_reference = [_joint_reference(np.append(joints[len(fields):], 0.0))]


def matrix_message(size: int) -> Float64MultiArray:
    """Zero matrix with labelled layout, row-major."""
    dimensions = [MultiArrayDimension(label='rows', size=size, stride=size * size),
                  MultiArrayDimension(label='columns', size=size, stride=size)]
    return Float64MultiArray(layout=MultiArrayLayout(dim=dimensions), data=[0.0] * size * size)


def fill_matrix(message: Float64MultiArray, numbers: np.ndarray) -> None:
    """Write the entries of a matrix."""
    message.data = list(numbers)


def fill_wrench(message: WrenchStamped, numbers: np.ndarray) -> None:
    """Write a wrench [N, Nm], shape ``(6,)``."""
    wrench = message.wrench
    for vector, part in ((wrench.force, numbers[:3]), (wrench.torque, numbers[3:])):
        vector.x, vector.y, vector.z = part.tolist()


def fill_pose_stamped(message: PoseStamped, numbers: np.ndarray) -> None:
    """Write a pose."""
    set_pose(message.pose, numbers)


def path_message(poses: np.ndarray, frame: str, stamp: Time) -> Path:
    """Path through poses (x, y, z, qw, qx, qy, qz), shape ``(T, 7)``."""
    result = Path()
    result.header.frame_id, result.header.stamp = frame, stamp
    result.poses.extend(PoseStamped(header=result.header, pose=pose_message(numbers))
                        for numbers in poses)
    return result


def tube_message(poses: np.ndarray, covariances: np.ndarray, frame: str, stamp: Time) -> Tube:
    """Poses as in `path_message`, with covariances, shape ``(T, 6, 6)``."""
    result = Tube()
    result.header.frame_id, result.header.stamp = frame, stamp
    result.poses.extend(
        PoseWithCovariance(pose=pose_message(numbers), covariance=covariance.reshape(-1))
        for numbers, covariance in zip(poses, covariances))
    return result


def checked_pose(message: PoseStamped, frame: str) -> np.ndarray:
    """
    (x, y, z, qw, qx, qy, qz) of a pose, normalised.

    :raises ManifoldError: if the frame is wrong, a number not finite or huge, or the quaternion
        not unit
    """
    if message.header.frame_id != frame:
        raise ManifoldError(f'pose is in frame {message.header.frame_id!r}, expected {frame!r}')
    return checked_numbers(message.pose)


def checked_numbers(pose: Pose) -> np.ndarray:
    """
    (x, y, z, qw, qx, qy, qz) of a pose, normalised.

    :raises ManifoldError: if a number is not finite or huge, or the quaternion not unit
    """
    return _normalized(pose_numbers(pose))


def transform_numbers(transform: Transform) -> np.ndarray:
    """
    (x, y, z, qw, qx, qy, qz) of a transform, normalised.

    :raises ManifoldError: if a number is not finite or huge, or the quaternion not unit
    """
    return _normalized(np.array(bags.transform_numbers(transform)))


def set_transform(transform: Transform, numbers: np.ndarray) -> None:
    """Write (x, y, z, qw, qx, qy, qz) to a transform."""
    p, q = transform.translation, transform.rotation
    p.x, p.y, p.z, q.w, q.x, q.y, q.z = (float(v) for v in numbers[:7])


def _normalized(numbers: np.ndarray) -> np.ndarray:
    if not np.isfinite(numbers).all():
        raise ManifoldError('pose has a NaN or infinite number')
    farthest = np.abs(numbers[:3]).max()
    if farthest > LARGEST_NUMBER:
        raise ManifoldError(f'a coordinate of the pose is {farthest:.3g} m, expected at most '
                            f'{LARGEST_NUMBER:g}')
    norm = float(np.linalg.norm(numbers[3:]))
    if abs(norm - 1.0) > QUATERNION_TOLERANCE:
        raise ManifoldError(f'quaternion norm is {norm:.6g}, expected 1 within '
                            f'{QUATERNION_TOLERANCE:g}')
    numbers[3:] /= norm
    return numbers


def lateness_diagnostics(node: str, level: bytes, message: str, figures: Punctuality,
                         extra: dict[str, object], stamp: Any) -> DiagnosticArray:
    """/diagnostics message of a node with a loop."""
    values = {'rate [Hz]': f'{figures.rate_hz:.1f}', 'ticks': figures.ticks,
              'missed ticks': figures.missed, 'lateness p50 [us]': f'{figures.p50_us:.0f}',
              'lateness p99 [us]': f'{figures.p99_us:.0f}',
              'lateness max [us]': f'{figures.max_us:.0f}', **extra}
    status = DiagnosticStatus(level=level, name=f'{node}: stream', message=message,
                              hardware_id='gdmp_ros')
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    result = DiagnosticArray(status=[status])
    result.header.stamp = stamp
    return result

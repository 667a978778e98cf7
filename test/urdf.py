"""A UR5e as a URDF, from its public kinematics, and the same by Denavit and Hartenberg."""
import numpy as np
from scipy.spatial.transform import Rotation

JOINTS = ('shoulder_pan_joint', 'shoulder_lift_joint', 'elbow_joint', 'wrist_1_joint',
          'wrist_2_joint', 'wrist_3_joint')
_PI = np.pi
#: Child link, position and roll, pitch, yaw of each joint in its parent; limit [rad].
_CHAIN = (('shoulder_link', (0, 0, 0.1625), (0, 0, 0), 2 * _PI),
          ('upper_arm_link', (0, 0, 0), (_PI / 2, 0, 0), 2 * _PI),
          ('forearm_link', (-0.425, 0, 0), (0, 0, 0), _PI),
          ('wrist_1_link', (-0.3922, 0, 0.1333), (0, 0, 0), 2 * _PI),
          ('wrist_2_link', (0, -0.0997, 0), (_PI / 2, 0, 0), 2 * _PI),
          ('wrist_3_link', (0, 0.0996, 0), (_PI / 2, _PI, _PI), 2 * _PI))
#: a, d and alpha of each joint [m, rad].
_DH = ((0, 0.1625, _PI / 2), (-0.425, 0, 0), (-0.3922, 0, 0), (0, 0.1333, _PI / 2),
       (0, 0.0997, -_PI / 2), (0, 0.0996, 0))


def _origin(xyz, rpy):
    return (f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>')


def ur5e(continuous=()):
    """:param continuous: names of joints without limits"""
    parts = ['<robot name="ur5e">', '<link name="base_link"/>', '<link name="base"/>',
             '<joint name="to_base" type="fixed"><parent link="base_link"/><child link="base"/>'
             f'{_origin((0, 0, 0), (0, 0, _PI))}</joint>',
             '<link name="base_link_inertia"><visual><geometry><mesh '
             'filename="package://ur_description/meshes/ur5e/visual/base.dae"/></geometry>'
             '</visual></link>',
             '<joint name="to_inertia" type="fixed"><parent link="base_link"/>'
             f'<child link="base_link_inertia"/>{_origin((0, 0, 0), (0, 0, _PI))}</joint>']
    parent = 'base_link_inertia'
    for name, (child, xyz, rpy, limit) in zip(JOINTS, _CHAIN):
        kind = 'continuous' if name in continuous else 'revolute'
        limits = '' if name in continuous else (
            f'<limit lower="{-limit}" upper="{limit}" effort="150" velocity="3.14"/>')
        parts.append(f'<link name="{child}"/><joint name="{name}" type="{kind}">'
                     f'<parent link="{parent}"/><child link="{child}"/>{_origin(xyz, rpy)}'
                     f'<axis xyz="0 0 1"/>{limits}</joint>')
        parent = child
    for child, rpy in (('flange', (0, -_PI / 2, -_PI / 2)), ('tool0', (_PI / 2, 0, _PI / 2))):
        parts.append(f'<link name="{child}"/><joint name="to_{child}" type="fixed">'
                     f'<parent link="{parent}"/><child link="{child}"/>'
                     f'{_origin((0, 0, 0), rpy)}</joint>')
        parent = child
    parts.append('</robot>')
    return '\n'.join(parts)


def by_denavit_hartenberg(position):
    """Pose of the tool in the frame ``base``."""
    turn, place = Rotation.identity(), np.zeros(3)
    for angle, (a, d, alpha) in zip(position, _DH):
        about = Rotation.from_euler('z', angle)
        place = place + turn.apply(about.apply([a, 0, 0]) + [0, 0, d])
        turn = turn * about * Rotation.from_euler('x', alpha)
    return np.concatenate([place, turn.as_quat(scalar_first=True)])

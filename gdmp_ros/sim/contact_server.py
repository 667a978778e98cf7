"""
The server of the protocol, with what touches its arm.

It runs in the environment of the server, which has not this package. A datagram of seven numbers
tells where a hand is: x, y, z, qw, qx, qy, qz of the site ``tcp``, in the frame of the base. The
hand is a spring and a damper. Without a datagram for 0.3 s it lets go.

The state of the robot has ``tau_ext_hat_filtered``: contacts, limits and the dry friction of the
joints, which a robot cannot tell apart either. The server itself leaves it 0.

usage: contact_server.py PORT ARGUMENT_OF_THE_SERVER …
"""
import socket
import struct
import sys
import time

import mujoco
import numpy as np

POSE = struct.Struct('<7d')
PATIENCE_S = 0.3
#: As the hand of the simulated arm: stiffness, damping, largest force; the same of rotations.
LINEAR, ANGULAR = (800.0, 110.0, 40.0), (40.0, 4.0, 6.0)


#: Share of the last torque in the one that is told, of each step of 1 ms.
SMOOTHING = 0.8


class Hand:
    """Pulls the tool to where datagrams say."""

    def __init__(self, port: int):
        """:param port: for datagrams"""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', port))
        self._socket.setblocking(False)
        self._pose: tuple[float, ...] = ()
        self._came = 0.0

    def guide(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the force of the hand to ``xfrc_applied``."""
        now = time.monotonic()
        try:
            while True:
                self._pose, self._came = POSE.unpack(self._socket.recv(POSE.size)), now
        except BlockingIOError:
            pass
        site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, 'tcp')
        body = model.site_bodyid[site]
        if not self._pose or now - self._came > PATIENCE_S:
            data.xfrc_applied[body] = 0.0
            return
        position, rotation = data.site_xpos[site], np.empty(4)
        velocity, turn = np.empty(6), np.empty(3)
        mujoco.mju_mat2Quat(rotation, data.site_xmat[site])
        mujoco.mju_negQuat(rotation, rotation)
        mujoco.mju_mulQuat(rotation, np.array(self._pose[3:]), rotation.copy())
        mujoco.mju_quat2Vel(turn, rotation, 1.0)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 0)
        force = _pulled(np.array(self._pose[:3]) - position, velocity[3:], *LINEAR)
        torque = _pulled(turn, velocity[:3], *ANGULAR)
        data.xfrc_applied[body, :3] = force
        data.xfrc_applied[body, 3:] = torque + np.cross(position - data.xipos[body], force)


def _pulled(error: np.ndarray, velocity: np.ndarray, stiffness: float, damping: float,
            largest: float) -> np.ndarray:
    force = stiffness * error - damping * velocity
    return force * min(1.0, largest / max(float(np.linalg.norm(force)), 1e-9))


def main() -> None:
    """Become the server."""
    # Only its environment has these.
    from franka_sim import run_server
    from franka_sim.mujoco_franka_sim import MujocoFrankaSim
    hand, step = Hand(int(sys.argv.pop(1))), mujoco.mj_step
    told, publish = np.zeros(7), MujocoFrankaSim._read_and_publish_state  # noqa: SLF001

    def guided_step(model: mujoco.MjModel, data: mujoco.MjData) -> None:
        hand.guide(model, data)
        step(model, data)

    def publish_torques(self: MujocoFrankaSim) -> None:
        publish(self)
        told[:] += (1.0 - SMOOTHING) * (self.data.qfrc_constraint[self.arm_dofs_idx] - told)
        self._state_snapshot = {  # noqa: SLF001  what the server sends is there
            **self._state_snapshot, 'tau_ext_hat_filtered': told.tolist()}  # noqa: SLF001
    # The server calls them by these names.
    mujoco.mj_step = guided_step
    MujocoFrankaSim._read_and_publish_state = publish_torques  # noqa: SLF001
    run_server.main()


if __name__ == '__main__':
    main()

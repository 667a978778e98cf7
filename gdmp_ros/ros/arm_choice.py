"""Which arm a command starts, and how."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
import importlib.util
import os
from pathlib import Path
from typing import Any, NamedTuple

from gdmp_ros.control.measurement import JointLimits
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.franka.protocol_server import await_server, check_port, interpreter
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.servo_arm import ServoArm
from gdmp_ros.util.optional_imports import extra
from gdmp_ros.util.processes import ChildProcesses

SIMULATED, FRANKA, FRANKA_GRIPPER = 'panda_sim', 'franka_arm', 'franka_gripper'
POSITION, SERVO_SIM = 'position_arm', 'servo_sim'
#: Distance from its goal at which a Franka counts as being there [m].
FRANKA_TOLERANCE = 0.006
#: Where the Franka hand has its tool, in the frame of the flange: the server of the protocol has
#: no hand.
HAND = {'tool_position': (0.0, 0.0, 0.1034),
        'tool_rotation': (0.9238795325112867, 0.0, 0.0, -0.3826834323650898)}


class Kind(NamedTuple):
    """What one kind of arm has; see the properties of `ArmChoice`."""

    node: str
    model: str = ''
    frame: str = 'panda_link0'
    tick_ns: int = 1_000_000
    robots: tuple[str, ...] = ()


#: By name (`gdmp_ros.choices.ARMS`).
KINDS = {'sim': Kind(SIMULATED), 'franka': Kind(FRANKA, 'fr3'),
         'ur5e': Kind(POSITION, 'ur5e', 'base_link', 2_000_000, (SERVO_SIM,))}


@dataclass(frozen=True)
class ArmChoice:
    """
    An arm to start.

    :ivar kind: ``sim``, ``franka``, or ``ur5e``: a simulated one that takes joint positions
    :ivar host: address of a Franka
    :ivar protocol_server: start a server of the protocol, instead of a robot
    :ivar parameter_files: of its node, such as one with its friction, and of what is in place of a
        robot; the last one wins
    """

    kind: str = 'sim'
    host: str = ''
    protocol_server: bool = False
    parameter_files: tuple[Path, ...] = ()

    @property
    def node(self) -> str:
        """Name of its node."""
        return KINDS[self.kind].node

    @property
    def model(self) -> str:
        """Model of it, as for ``panda_sim``."""
        return KINDS[self.kind].model

    @property
    def frame(self) -> str:
        """Frame of its base."""
        return KINDS[self.kind].frame

    @property
    def tick_ns(self) -> int:
        """Time between two ticks of its node [ns]."""
        return KINDS[self.kind].tick_ns

    @property
    def robots(self) -> tuple[str, ...]:
        """Nodes that are started in place of a robot."""
        return KINDS[self.kind].robots

    @property
    def shown_on(self) -> dict[str, Any]:
        """Parameters of ``panda_sim``, as which this arm, or one like it, is guided by hand."""
        return {'model': self.model, 'frame_id': self.frame} if self.robots else {}

    @property
    def limits(self) -> JointLimits:
        """Limits of its joints."""
        return Arm(self.model).limits

    def check(self) -> None:
        """
        Check everything before work is done.

        :raises GdmpError: if something is missing or contradicts something else
        """
        for path in self.parameter_files:
            if not path.is_file():
                raise DataError(f'{path}: there is no such file; gdmp arm friction writes one')
        if self.kind != 'franka':
            if self.host or self.protocol_server:
                raise ParameterError('--host and --protocol-server need --arm franka')
            return
        if importlib.util.find_spec('pylibfranka') is None:
            raise DataError(f"pylibfranka is missing{extra('franka')}")
        if self.protocol_server:
            if self.host:
                raise ParameterError('--protocol-server is the robot itself: leave --host out')
            interpreter()
            check_port()
        elif not self.host:
            raise ParameterError('--arm franka needs --host, the address of the robot, or '
                                 '--protocol-server')

    def parameters(self) -> dict[str, Any]:
        """Parameters of its node."""
        if self.kind == 'ur5e':
            # The hand hangs at the sensor.
            hand = ServoArm(self.model).hand
            return {'model': self.model, 'payload_mass': hand.mass,
                    'payload_center': list(hand.center)}
        if self.kind != 'franka':
            return {}
        if self.protocol_server:
            return {'host': '127.0.0.1', 'wall_time': True, **HAND}
        return {'host': self.host}

    def arguments(self) -> list[str]:
        """More ROS arguments of its node, and of `robots`."""
        return [word for path in self.parameter_files for word in ('--params-file', str(path))]

    def server_parameters(self) -> dict[str, Any]:
        """Parameters of a trajectory server for it, in its namespace."""
        # Dry friction holds a Franka some millimetres from its goal, compensated or not.
        result: dict[str, Any] = {'measured_pose_topic': f'{self.node}/measured_pose',
                                  'arm_status_topic': f'{self.node}/status'}
        if self.kind == 'franka':
            result['robot_position_tolerance'] = FRANKA_TOLERANCE
        if self.kind == 'ur5e':
            result['frame_id'] = self.frame
        return {**result, 'reach_model': self.model} if self.model else result

    @contextmanager
    def robot(self, folder: Path, gripper: bool = False, hand: bool = False,
              world: Mapping[str, Any] | None = None) -> Iterator[None]:
        """
        The robot itself, as long as the context lasts; the server of the protocol if wanted.

        :param folder: for its log
        :param gripper: whether the server has a gripper, and something to hold
        :param hand: whether a hand may guide the arm behind the server
        :param world: what the server simulates (``model``: a file); by default the arm alone
        """
        with ChildProcesses(os.environ, folder) as children:
            if self.protocol_server:
                children.start('protocol_server', 'gdmp_ros.franka.protocol_server', [
                    *(['--gripper', '--object-width', '0.04'] if gripper else []),
                    *(['--hand'] if hand else []),
                    *(word for name, value in (world or {}).items()
                      for word in (f'--{name}', str(value)))])
                await_server(children.check)
            yield

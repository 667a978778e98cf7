"""Services of an arm."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import json

from gdmp_msgs.srv import MoveJoints, SetPayload, SetTool
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.guard import ARMED_S, ReferenceGuard
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import JointMotion, PostureMotion
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.arm.commands import ArmCommands
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import pose_numbers
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.known_model import PAYLOAD_S
from gdmp_ros.sim.payload import Payload

#: Speed of a joint that moves to a posture, unless another is given [rad/s].
MOVING_SPEED = 0.5


class ArmServices:
    """
    What a user or another node may ask of an arm, besides following references.

    :ivar guiding: what to do after hand guiding has begun
    """

    guiding = 'only gravity is compensated: guide the arm by hand'

    def __init__(self, node: ManagedNode, commands: ArmCommands, is_active: Callable[[], bool],
                 moved: Callable[[], None], home: np.ndarray):
        """
        Add the services.

        :param home: posture to move to without another one [rad]
        :param is_active: whether the loop of the arm runs
        :param moved: called after the tool has changed
        """
        self._node, self._commands, self._is_active = node, commands, is_active
        self._control, self._moved, self._home = commands.control, moved, home
        for name, action in (('arm', self._arm), ('stop', self._stop), ('comply', self._comply)):
            node.add_service(Trigger, name, partial(self.on_command, action))
        node.add_service(SetBool, 'teach', self.on_teach)
        node.add_service(Trigger, 'refill_tank', self.on_refill)
        node.add_service(SetPayload, 'set_payload', self.on_payload)
        # They await something.
        for kind, name, answer in (
                (Trigger, 'recover', self.on_recover), (SetTool, 'set_tool', self.on_tool),
                (MoveJoints, 'move_joints', self.on_move),
                (SetBool, 'identify_friction', self.on_identify)):
            node.add_service(kind, name, answer, concurrent=True)

    def on_command(self, action: Callable[[ReferenceGuard], str], request: Trigger.Request,
                   reply: Trigger.Response) -> Trigger.Response:
        """``~/arm``, ``~/stop`` and ``~/comply``."""
        try:
            reply.message = action(self._control.controller.guard)
            reply.success = True
        except ParameterError as error:
            reply.message = str(error)
        return reply

    def _arm(self, guard: ReferenceGuard) -> str:
        _check_fault(guard)
        if self._control.hand_guided:
            raise ParameterError('the arm is guided by hand: end it first (~/teach)')
        self._commands.requests.append(guard.arm)
        return (f'the arm follows the motion that is streamed, or begins within {ARMED_S:g} s, '
                'from wherever it is')

    def _stop(self, guard: ReferenceGuard) -> str:
        reason = '~/stop was called'
        self._commands.request_end_of_joint_motion(reason)
        self._commands.requests.append(partial(guard.stop, reason))
        return 'the arm stops and holds'

    def _comply(self, guard: ReferenceGuard) -> str:
        _check_fault(guard)
        self._commands.requests.append(partial(guard.comply, '~/comply was called'))
        return 'the arm stops and gives way, until ~/stop or ~/arm'

    def on_teach(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        self._commands.request_hand_guiding(request.data)
        reply.success = True
        reply.message = self.guiding if request.data else 'the arm holds its pose'
        return reply

    def on_refill(self, request: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        controller = self._control.controller
        controller.refill_tank()
        reply.success = True
        reply.message = f'the energy tank is filled to {controller.settings.tank.energy:g} J'
        return reply

    def on_payload(self, request: SetPayload.Request, reply: SetPayload.Response
                   ) -> SetPayload.Response:
        try:
            self._commands.announce(Payload(
                request.mass, tuple(request.center), tuple(request.inertia)))
            reply.success = True
            reply.message = f'the arm carries {request.mass:g} kg, {PAYLOAD_S:g} s from now on'
        except ParameterError as error:
            reply.message = str(error)
        return reply

    async def on_recover(self, request: Trigger.Request, reply: Trigger.Response
                         ) -> Trigger.Response:
        """Answers when the fault has ended."""
        try:
            if self._control.controller.guard.mode is not ArmMode.FAULT:
                raise ParameterError('the arm is not in a fault')
            await self._carried_out(self._commands.request_recovery())
            reply.success = True
            reply.message = 'the arm holds; a motion must begin near it, or call ~/arm'
        except GdmpError as error:
            reply.message = str(error)
        return reply

    async def on_tool(self, request: SetTool.Request, reply: SetTool.Response) -> SetTool.Response:
        """Answers when the tool has changed."""
        try:
            pose = pose_numbers(request.pose)
            tool = ToolTransform(tuple(pose[:3]), tuple(pose[3:]))
            await self._carried_out(self._commands.request_tool(tool))
            self._moved()
            reply.success = True
            reply.message = f'the tool is at {np.round(pose[:3], 4)} m of its site'
        except GdmpError as error:
            reply.message = str(error)
        return reply

    async def on_move(self, request: MoveJoints.Request, reply: MoveJoints.Response
                      ) -> MoveJoints.Response:
        """Answers when the joints have arrived."""
        commands = self._commands
        goal = np.array(request.position) if len(request.position) else self._home
        speed, joints = request.speed or MOVING_SPEED, self._control.joints
        try:
            joints.check(goal)
            via = _postures(request.via, len(goal))
            commands.request_joint_motion(lambda: PostureMotion(
                joints, np.vstack([commands.position(), via, goal]), speed))
            await self._moved_joints()
            reply.success, reply.message = True, 'the arm has arrived'
        except GdmpError as error:
            reply.message = str(error)
        return reply

    async def _moved_joints(self) -> JointMotion:
        """
        Wait for the end of motions of the joints.

        :raises ParameterError: if they ended early
        """
        commands, control = self._commands, self._control
        await self._node.wait_until(lambda: not (self._is_active() and commands.moves_joints))
        motion = control.joint_motion
        if motion is None or not motion.done:
            raise ParameterError(control.joint_motion_problem or 'it was ended')
        return motion

    async def _carried_out(self, done: list[str]) -> None:
        """
        Wait until a request has been carried out.

        :param done: see `ArmCommands.request_tool`
        :raises ParameterError: if it was refused, or the node is not active
        """
        await self._node.wait_until(lambda: bool(done) or not self._is_active(), 0.01)
        reason = done[0] if done else 'the node is not active'
        if reason:
            raise ParameterError(reason)

    async def on_identify(self, request: SetBool.Request, reply: SetBool.Response
                           ) -> SetBool.Response:
        """Answers when the motions have ended, with the friction as JSON."""
        commands = self._commands
        try:
            if not self._is_active():
                raise ParameterError('the node is not active')
            if not request.data:
                commands.request_end_of_joint_motion('it was ended')
                reply.success, reply.message = True, 'the arm holds'
                return reply
            commands.request_joint_motion(
                lambda: FrictionIdentification(self._control.joints, commands.position()))
            motion = await self._moved_joints()
            if not isinstance(motion, FrictionIdentification):
                raise ParameterError('it was ended')
            result = motion.result()
            reply.message = json.dumps({name: [round(float(value), 4) for value in values]
                                        for name, values in result._asdict().items()})
            reply.success = True
        except GdmpError as error:
            reply.message = str(error)
        return reply


def _postures(numbers: Sequence[float], joints: int) -> np.ndarray:
    """
    Postures on the way, shape ``(T, n)``.

    :raises ParameterError: if they are not finite, or a posture is not complete
    """
    result = np.array(numbers)
    if result.size % joints or not np.isfinite(result).all():
        raise ParameterError(f'via has {result.size} numbers, expected finite ones, {joints} for '
                             'each posture')
    return result.reshape(-1, joints)


def _check_fault(guard: ReferenceGuard) -> None:
    if guard.mode is ArmMode.FAULT:
        raise ParameterError(f'the arm is in a fault ({guard.reason}): call ~/recover first')

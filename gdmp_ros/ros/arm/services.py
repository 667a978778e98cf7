"""Services of an arm."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import json
from typing import Any

from gdmp_msgs.srv import MoveJoints, SetPayload, SetTool
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.guard import ARMED_S
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import JointMotion, PostureMotion
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.arm.commands import ArmCommands
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import pose_numbers
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.known_model import PAYLOAD_S
from gdmp_ros.sim.payload import Payload

#: Speed of a joint that moves to a posture, unless another is given [rad/s].
MOVING_SPEED = 0.5
#: Time between two looks for an answer [s].
LOOK_S = 0.005


class ArmServices:
    """
    What a user or another node may ask of an arm, besides following references.

    :ivar guiding: what to do after hand guiding has begun
    """

    guiding = 'only gravity is compensated: guide the arm by hand'

    def __init__(self, node: ManagedNode, commands: ArmCommands, is_active: Callable[[], bool],
                 moved: Callable[[], None], home: np.ndarray):
        """
        Add the services; each answers when its request has been carried out.

        :param home: posture to move to without another one [rad]
        :param is_active: whether the loop of the arm runs
        :param moved: called after the tool has changed
        """
        self._node, self._commands, self._is_active = node, commands, is_active
        self._control, self._moved, self._home = commands.control, moved, home
        triggers: dict[str, tuple[Request, Callable[[], str]]] = {
            'arm': (Request.ARM, lambda: 'the arm follows the motion that is streamed, or begins '
                    f'within {ARMED_S:g} s, from wherever it is'),
            'stop': (Request.STOP, lambda: 'the arm stops and holds'),
            'comply': (Request.COMPLY, lambda: 'the arm stops and gives way, until ~/stop or '
                       '~/arm'),
            'recover': (Request.RECOVER, lambda: 'the arm holds; a motion must begin near it, or '
                        'call ~/arm'),
            'refill_tank': (Request.REFILL, self._filled)}
        for name, (what, said) in triggers.items():
            node.add_service(Trigger, name, partial(self.on_trigger, what, said), concurrent=True)
        for kind, name, answer in (
                (SetBool, 'teach', self.on_teach), (SetPayload, 'set_payload', self.on_payload),
                (SetTool, 'set_tool', self.on_tool), (MoveJoints, 'move_joints', self.on_move),
                (SetBool, 'identify_friction', self.on_identify)):
            node.add_service(kind, name, answer, concurrent=True)

    async def on_trigger(self, what: Any, said: Callable[[], str], request: Trigger.Request,
                         reply: Trigger.Response) -> Trigger.Response:
        """Services without a request; ``said`` describes what has been done."""
        return await self._replied(reply, what, None, said)

    def _filled(self) -> str:
        return ('the energy tank is filled to '
                f'{self._control.controller.settings.tank.energy:g} J')

    async def on_teach(self, request: SetBool.Request, reply: SetBool.Response
                       ) -> SetBool.Response:
        return await self._replied(
            reply, Request.GUIDE if request.data else Request.RELEASE, None,
            lambda: self.guiding if request.data else 'no hand guides the arm')

    async def on_payload(self, request: SetPayload.Request, reply: SetPayload.Response
                         ) -> SetPayload.Response:
        try:
            payload = Payload(request.mass, tuple(request.center), tuple(request.inertia))
        except ParameterError as error:
            reply.message = str(error)
            return reply
        return await self._replied(reply, Request.PAYLOAD, payload, lambda: (
            f'the arm carries {request.mass:g} kg, {PAYLOAD_S:g} s from now on'))

    async def on_tool(self, request: SetTool.Request, reply: SetTool.Response) -> SetTool.Response:
        try:
            pose = pose_numbers(request.pose)
            tool = ToolTransform(tuple(pose[:3]), tuple(pose[3:]))
        except GdmpError as error:
            reply.message = str(error)
            return reply
        await self._replied(reply, Request.TOOL, tool, lambda: (
            f'the tool is at {pose[:3].round(4).tolist()} m of its site'))
        if reply.success:
            self._moved()
        return reply

    async def on_move(self, request: MoveJoints.Request, reply: MoveJoints.Response
                      ) -> MoveJoints.Response:
        """Answers when the joints have arrived."""
        joints = self._control.joints
        try:
            goal = np.array(request.position) if len(request.position) else self._home
            joints.check(goal)
            postures = np.vstack([_postures(request.via, len(goal)), goal])
            await self._moved_joints(PostureMotion(joints, postures,
                                                   request.speed or MOVING_SPEED))
            reply.success, reply.message = True, 'the arm has arrived'
        except GdmpError as error:
            reply.message = str(error)
        return reply

    async def on_identify(self, request: SetBool.Request, reply: SetBool.Response
                          ) -> SetBool.Response:
        """Answers when the motions have ended, with the friction as JSON."""
        if not request.data:
            return await self._replied(reply, Request.STOP, None, lambda: 'the arm holds')
        motion = FrictionIdentification(self._control.joints)
        try:
            await self._moved_joints(motion)
            reply.message = json.dumps({name: [round(float(value), 4) for value in values]
                                        for name, values in motion.result()._asdict().items()})
            reply.success = True
        except GdmpError as error:
            reply.message = str(error)
        return reply

    async def _moved_joints(self, motion: JointMotion) -> None:
        """
        Let motions of the joints begin, and wait for their end.

        :raises ParameterError: if they are refused, or ended early
        """
        control = self._control
        await self._carried_out(motion.request, motion)
        await self._node.wait_until(lambda: not control.moves_joints)
        if not motion.done:
            raise ParameterError(control.joint_motion_problem or 'it was ended')

    async def _replied(self, reply: Any, request: Any, argument: Any, said: Callable[[], str]
                       ) -> Any:
        """Reply when a request has been carried out, or with the reason of the refusal."""
        try:
            await self._carried_out(request, argument)
            reply.success, reply.message = True, said()
        except ParameterError as error:
            reply.message = str(error)
        return reply

    async def _carried_out(self, request: Any, argument: Any) -> None:
        """
        Wait until a request has been carried out.

        :raises ParameterError: if it is refused
        """
        if not self._is_active():
            raise ParameterError('the node is not active')
        answer = self._commands.ask(request, argument)
        await self._node.wait_until(lambda: answer.done, LOOK_S)
        if answer.refusal:
            raise ParameterError(answer.refusal)


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

"""Services and actions of an arm."""
from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TYPE_CHECKING

from gdmp_msgs.action import IdentifyFriction, MoveJoints
from gdmp_msgs.srv import SetPayload, SetTool
import numpy as np
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.arm_states import Request
from gdmp_ros.control.guard import ARMED_S
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import JointMotion, PostureMotion
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.messages import pose_numbers
from gdmp_ros.ros.middleware import end_goal
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.known_model import PAYLOAD_S
from gdmp_ros.sim.payload import Payload
from gdmp_ros.util.names import indices_of

if TYPE_CHECKING:
    from gdmp_ros.ros.arm.node import ArmNode

#: Speed of a joint that moves to a posture, unless another is given [rad/s].
MOVING_SPEED = 0.5
#: Time between two looks for an answer, and between two messages of feedback [s].
LOOK_S, FEEDBACK_S = 0.005, 0.05


class ArmServices:
    """What a user or another node may ask of an arm, besides following references."""

    def __init__(self, node: ArmNode):
        """Add the services; each answers when its request has been carried out."""
        self._node, self._commands, self._control = node, node.commands, node.control
        self.offer('arm', Request.ARM, lambda: (
            'the arm follows the motion that is streamed, or begins within '
            f'{ARMED_S:g} s, from wherever it is'))
        self.offer('stop', Request.STOP, lambda: 'the arm stops and holds')
        self.offer('comply', Request.COMPLY,
                   lambda: 'the arm stops and gives way, until ~/stop or ~/arm')
        self.offer('recover', Request.RECOVER,
                   lambda: 'the arm holds; a motion must begin near it, or call ~/arm')
        self.offer('refill_tank', Request.REFILL, lambda: (
            'the energy tank is filled to '
            f'{self._control.controller.settings.tank.energy:g} J'))
        for kind, name, answer in (
                (SetBool, 'teach', self.on_teach), (SetPayload, 'set_payload', self.on_payload),
                (SetTool, 'set_tool', self.on_tool)):
            node.add_service(kind, name, answer, concurrent=True)
        for kind, name, make in ((MoveJoints, 'move_joints', self.move),
                                 (IdentifyFriction, 'identify_friction', self.identify)):
            node.add_action(kind, f'~/{name}', make, accept=lambda _: True, cancel=True)

    def offer(self, name: str, request: Request, said: Callable[[], str]) -> None:
        """
        Add a service without an argument.

        :param said: describes what has been done
        """
        self._node.add_service(Trigger, name, partial(self._on_trigger, request, said),
                               concurrent=True)

    async def _on_trigger(self, request: Request, said: Callable[[], str], _: Trigger.Request,
                          reply: Trigger.Response) -> Trigger.Response:
        return await self._replied(reply, request, None, said)

    async def on_teach(self, request: SetBool.Request, reply: SetBool.Response
                       ) -> SetBool.Response:
        return await self._replied(
            reply, Request.GUIDE if request.data else Request.RELEASE, None,
            lambda: self._node.backend.guiding if request.data else 'no hand guides the arm')

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
            self._node.describe()
        return reply

    async def move(self, handle: Any) -> MoveJoints.Result:
        """Move the joints to a posture."""
        request, control, result = handle.request, self._control, MoveJoints.Result()

        def plan() -> JointMotion:
            given, goal = request.joint_names, np.array(request.position)
            order: Any = slice(None)
            if len(given):
                if len(goal) not in (0, len(given)):
                    raise ParameterError(f'{len(given)} joint names and {len(goal)} positions')
                order = indices_of(self._node.joint_names, given, 'the joint')
            goal = goal[order] if len(goal) else self._node.backend.model.home
            ways = _postures(request.via, len(goal))[:, order]
            control.joints.check(goal)
            postures = np.vstack([ways, goal])
            control.controller.check_way(postures)
            return PostureMotion(control.joints, postures, request.speed or MOVING_SPEED)
        await self._make(handle, result, plan, lambda motion: MoveJoints.Feedback(
            remaining=motion.remaining))
        return result

    async def identify(self, handle: Any) -> IdentifyFriction.Result:
        """Measure the friction of the joints, and weight that the model lacks."""
        control, result = self._control, IdentifyFriction.Result()
        motion = FrictionIdentification(control.joints, control.driver.chain)

        def complete() -> None:
            result.joint_names = list(self._node.joint_names)
            result.viscous, result.dry, result.weight_moments = (
                values.ravel().round(4).tolist() for values in motion.result())
        await self._make(handle, result, lambda: motion, lambda _: IdentifyFriction.Feedback(
            activity=motion.what, remaining=motion.remaining), complete)
        return result

    async def _make(self, handle: Any, result: Any, plan: Callable[[], JointMotion],
                    feedback: Callable[[JointMotion], Any],
                    complete: Callable[[], None] = lambda: None) -> None:
        """
        Make motions of the joints for the goal of an action, and end it.

        A goal that is refused is accepted first: a rejection could not carry the reason.

        :param complete: writes what motions that were made have shown into the result
        """
        control, stopped = self._control, False

        def over() -> bool:
            nonlocal stopped
            if handle.is_cancel_requested and not stopped:
                stopped = True
                self._commands.ask(Request.STOP)
            if control.joint_motion is motion:
                handle.publish_feedback(feedback(motion))
            return not control.moves_joints
        try:
            motion = plan()
            await self._carried_out(motion.request, motion)
            await self._node.wait_until(over, FEEDBACK_S)
            if not motion.done:
                raise ParameterError(control.joint_motion_problem or 'it was ended')
            complete()
            result.success = True
        except GdmpError as error:
            result.message = str(error)
        end_goal(handle, result.success)

    async def _replied(self, reply: Any, request: Request, argument: Any, said: Callable[[], str]
                       ) -> Any:
        """Reply when a request has been carried out, or with the reason of the refusal."""
        try:
            await self._carried_out(request, argument)
            reply.success, reply.message = True, said()
        except ParameterError as error:
            reply.message = str(error)
        return reply

    async def _carried_out(self, request: Request, argument: Any) -> None:
        """
        Wait until a request has been carried out.

        :raises ParameterError: if it is refused
        """
        if not self._node.active:
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

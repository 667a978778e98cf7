"""Services of the simulated arm."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial
import json

from gdmp_msgs.srv import SetPayload, SetTool, StepSimulation
import numpy as np
from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.control.guard import ARMED_S, ReferenceGuard
from gdmp_ros.control.modes import ArmMode
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.ros.arm.simulation import Simulation
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import pose_numbers
from gdmp_ros.sim.known_model import PAYLOAD_S
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.tool import ToolTransform

#: Time for steps of a paused simulation, beyond their own duration [s].
STEP_TIMEOUT_S = 5.0
#: Largest payload [kg].
LARGEST_PAYLOAD = 20.0


class Services:
    """What a user or another node may ask of the arm, besides following references."""

    def __init__(self, node: ManagedNode, simulation: Simulation, is_active: Callable[[], bool],
                 moved: Callable[[], None]):
        """
        Add the services.

        :param is_active: whether the simulation runs
        :param moved: called after the tool has changed
        """
        self._node, self.simulation, self._is_active = node, simulation, is_active
        self._moved = moved
        for name, action in (('arm', self._arm), ('stop', self._stop), ('comply', self._comply),
                             ('recover', self._recover)):
            node.add_service(Trigger, name, partial(self.on_command, action))
        node.add_service(SetBool, 'set_pause', self.on_pause)
        node.add_service(SetBool, 'teach', self.on_teach)
        node.add_service(Trigger, 'reset_world', self.on_reset)
        node.add_service(Trigger, 'refill_tank', self.on_refill)
        node.add_service(SetPayload, 'set_payload', self.on_payload)
        # They await: in the default group they would block the other services.
        node.add_service(SetTool, 'set_tool', self.on_tool, ReentrantCallbackGroup())
        node.add_service(StepSimulation, 'step_simulation', self.on_step,
                         ReentrantCallbackGroup())
        node.add_service(SetBool, 'identify_friction', self.on_identify,
                         ReentrantCallbackGroup())

    def on_command(self, action: Callable[[ReferenceGuard], str], request: Trigger.Request,
                   reply: Trigger.Response) -> Trigger.Response:
        """``~/arm``, ``~/stop``, ``~/comply`` and ``~/recover``."""
        try:
            reply.message = action(self.simulation.loop.controller.guard)
            reply.success = True
        except ParameterError as error:
            reply.message = str(error)
        return reply

    def _arm(self, guard: ReferenceGuard) -> str:
        _check_fault(guard)
        if self.simulation.loop.hand_guided:
            raise ParameterError('the arm is guided by hand: end it first (~/teach)')
        self.simulation.requests.append(guard.arm)
        return (f'the arm follows the motion that is streamed, or begins within {ARMED_S:g} s, '
                'from wherever it is')

    def _stop(self, guard: ReferenceGuard) -> str:
        self.simulation.requests.append(guard.stop)
        return 'the arm stops and holds'

    def _comply(self, guard: ReferenceGuard) -> str:
        _check_fault(guard)
        self.simulation.requests.append(partial(guard.comply, '~/comply was called'))
        return 'the arm stops and gives way, until ~/stop or ~/arm'

    def _recover(self, guard: ReferenceGuard) -> str:
        if guard.mode is not ArmMode.FAULT:
            raise ParameterError('the arm is not in a fault')
        self.simulation.requests.append(guard.recover)
        return 'the arm holds; a motion must begin near it, or call ~/arm'

    def on_pause(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        self.simulation.pause(request.data)
        reply.success = True
        reply.message = 'paused' if request.data else 'running'
        return reply

    def on_teach(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        self.simulation.request_hand_guiding(request.data)
        reply.success = True
        reply.message = ('only gravity is compensated: guide the arm by ~/hand_pose or with the '
                         'mouse' if request.data else 'the arm holds its pose')
        return reply

    def on_reset(self, request: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        self.simulation.request_reset()
        reply.success, reply.message = True, 'the arm is reset to its first keyframe'
        return reply

    def on_refill(self, request: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        controller = self.simulation.loop.controller
        controller.refill_tank()
        reply.success = True
        reply.message = f'the energy tank is filled to {controller.settings.tank.energy:g} J'
        return reply

    def on_payload(self, request: SetPayload.Request, reply: SetPayload.Response
                   ) -> SetPayload.Response:
        try:
            if not request.mass <= LARGEST_PAYLOAD:
                raise ParameterError(f'mass is {request.mass!r} kg, expected 0 to '
                                     f'{LARGEST_PAYLOAD:g}')
            self.simulation.loop.arm.announce(Payload(
                request.mass, tuple(request.center), tuple(request.inertia)))
            reply.success = True
            reply.message = f'the arm carries {request.mass:g} kg, {PAYLOAD_S:g} s from now on'
        except ParameterError as error:
            reply.message = str(error)
        return reply

    async def on_tool(self, request: SetTool.Request, reply: SetTool.Response
                      ) -> SetTool.Response:
        """Answers when the tool has changed."""
        try:
            pose = pose_numbers(request.pose)
            tool = ToolTransform(tuple(pose[:3]), tuple(pose[3:]))
            if not self._is_active():
                raise ParameterError('the node is not active')
            done = self.simulation.request_tool(tool)
            await self._node.wait_until(lambda: bool(done) or not self._is_active())
            reply.message = done[0] if done else 'the node was deactivated'
            reply.success = done == ['']
        except ParameterError as error:
            reply.message = str(error)
        if reply.success:
            self._moved()
            reply.message = f'the tool is at {np.round(pose[:3], 4)} m of its site'
        return reply

    async def on_identify(self, request: SetBool.Request, reply: SetBool.Response
                           ) -> SetBool.Response:
        """Answers when the motions have ended, with the friction as JSON."""
        simulation = self.simulation
        try:
            if not self._is_active():
                raise ParameterError('the node is not active')
            simulation.request_identification(request.data)
            if not request.data:
                reply.success, reply.message = True, 'the arm holds'
                return reply
            await self._node.wait_until(lambda: not self._is_active() or not simulation.identifies)
            identification = simulation.loop.identification
            if identification is None or not identification.done:
                raise ParameterError(simulation.identification_problem or 'it was ended')
            found = identification.result()
            reply.message = json.dumps({name: [round(float(one), 4) for one in values]
                                        for name, values in found._asdict().items()})
            reply.success = True
        except GdmpError as error:
            reply.message = str(error)
        return reply

    async def on_step(self, request: StepSimulation.Request,
                       reply: StepSimulation.Response) -> StepSimulation.Response:
        simulation = self.simulation
        try:
            if not self._is_active():
                raise ParameterError('the node is not active')
            simulation.request_steps(request.steps)
            seconds = request.steps * simulation.loop.arm.period + STEP_TIMEOUT_S
            await self._node.wait_until(lambda: simulation.steps_left == 0, 0.005, seconds)
            if simulation.steps_left:
                raise ParameterError(f'{simulation.steps_left} of {request.steps} steps were not '
                                     'made in time')
            if simulation.steps_dropped:
                raise ParameterError(f'{simulation.steps_dropped} of {request.steps} steps were '
                                     'not made: ~/set_pause was called')
            reply.success = True
        except ParameterError as error:
            reply.message = str(error)
        reply.time = simulation.loop.arm.time
        return reply


def _check_fault(guard: ReferenceGuard) -> None:
    if guard.mode is ArmMode.FAULT:
        raise ParameterError(f'the arm is in a fault ({guard.reason}): call ~/recover first')

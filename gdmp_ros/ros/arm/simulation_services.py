"""Services of the simulated arm alone."""
from __future__ import annotations

from collections.abc import Callable
from functools import partial

from gdmp_msgs.srv import StepSimulation
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.errors import ParameterError
from gdmp_ros.ros.arm.services import ArmServices
from gdmp_ros.ros.arm.simulation import Reset, Simulation
from gdmp_ros.ros.lifecycle import ManagedNode

#: Time for steps of a paused simulation, beyond their own duration [s].
STEP_TIMEOUT_S = 5.0


class SimulationServices(ArmServices):
    """The services of an arm; and pause, steps and reset of its simulation."""

    guiding = 'only gravity is compensated: guide the arm by ~/hand_pose or with the mouse'

    def __init__(self, node: ManagedNode, simulation: Simulation, is_active: Callable[[], bool],
                 moved: Callable[[], None]):
        """Add the services; see `ArmServices`."""
        super().__init__(node, simulation, is_active, moved, simulation.loop.arm.home)
        self.simulation = simulation
        node.add_service(SetBool, 'set_pause', self.on_pause)
        node.add_service(Trigger, 'reset_world', partial(
            self.on_trigger, Reset.RESET, lambda: 'the arm is reset to its first keyframe'),
            concurrent=True)
        node.add_service(StepSimulation, 'step_simulation', self.on_step, concurrent=True)

    def on_pause(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        self.simulation.pause(request.data)
        reply.success = True
        reply.message = 'paused' if request.data else 'running'
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

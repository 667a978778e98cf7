"""A simulated arm instead of the robot, in MuJoCo: follows references at 1 kHz."""
from __future__ import annotations

from gdmp_msgs.srv import StepSimulation
from geometry_msgs.msg import PoseStamped
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import SetBool

from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.plain_tick import is_event, OTHER
from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.realtime.loop import Loop, NS, periodic
from gdmp_ros.realtime.native import LEFT, PERIOD, prepared, STAMP
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.backend import ArmBackend
from gdmp_ros.ros.arm.compiled_loop import (
    ASKED,
    MAX_CATCH_UP,
    MESSAGE,
    MODE,
    SEQUENCE,
    SimulatedLoop,
    warm_up,
)
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import hand_settings, simulated_arm, SIMULATION
from gdmp_ros.ros.gripper import GripperInterface
from gdmp_ros.ros.messages import checked_pose, stamp_of
from gdmp_ros.ros.middleware import CLOCK_DEPTH
from gdmp_ros.ros.running import run
from gdmp_ros.scene.scene import Scene
from gdmp_ros.sim.closed_loop import SimulatedDriver
from gdmp_ros.sim.plain_tick import end_tick, only_goes_on
from gdmp_ros.sim.teaching import Hand
from gdmp_ros.sim.viewer import Viewer
from gdmp_ros.sim.volumes import follow_scene

#: Time between two looks whether a simulation is still paused [ns].
PAUSED_NS = 1_000_000
#: The viewer is updated once in this many ticks.
VIEWER_EVERY = 16
#: Without a message for this time the hand releases the tool [s].
HAND_TIMEOUT_S = 0.3
MAX_STEPS = 100_000
#: Time for steps of a paused simulation, beyond their own duration [s].
STEP_TIMEOUT_S = 5.0


class SimulatedArm(ArmBackend):
    """
    An arm in a simulation, which can be paused, stepped and reset; a hand may pull its tool.

    :ivar driver: of the arm
    :ivar compiled: loop that makes its ticks without the interpreter, if there is one
    :ivar paused: whether time passes by ``~/step_simulation`` only
    """

    name, specs = 'panda_sim', SIMULATION
    guiding = 'only gravity is compensated: guide the arm by ~/hand_pose or with the mouse'
    driver: SimulatedDriver
    _viewer: Viewer | None = None
    compiled: SimulatedLoop | None = None

    def open(self) -> SimulatedDriver:
        self.model, gripper = simulated_arm(self.node.parameters)
        self.driver, self.period = SimulatedDriver(self.model, gripper), self.model.period
        self.paused = False
        # Ticks of the last request that a pause prevented.
        self._steps_dropped = 0
        # Only the loop counts ticks, and only the other thread sets the last one of a request.
        self._ticks = self._last_tick = 0
        self._hand_problem = ''
        self._hand_seen: PoseStamped | None = None
        return self.driver

    def surround(self, scene: Scene) -> None:
        follow_scene(self.model, scene)

    def offer(self) -> None:
        node = self.node
        if node.parameters.pace == 'fast':
            self._clock_out = node.add_publisher(ClockMessage, '/clock', CLOCK_DEPTH)
        node.add_subscription(PoseStamped, '~/hand_pose', self._on_hand)
        node.add_service(SetBool, 'set_pause', self._on_pause)
        node.arm_services.offer('reset_world', Request.RESET,
                            lambda: 'the arm is reset to its first keyframe')
        node.add_service(StepSimulation, 'step_simulation', self._on_step, concurrent=True)
        node.control.states.watchers.append(self._entered)
        node.state_out.others = lambda: self.driver.others
        if self.driver.gripper is not None:
            GripperInterface(node, self.driver.gripper)
        if node.parameters.pace != 'fast':
            self._compile()

    def _compile(self) -> None:
        """Prepare the loop that does not need the interpreter, if the middleware allows it."""
        node, commands = self.node, self.node.commands
        loop = self.compiled = prepared(
            lambda: SimulatedLoop(commands.references, commands.reader, node.state_out),
            node.get_logger().info)
        if loop is not None:
            warm_up(node.control, self.driver)
            commands.called = loop.call
            if self.driver.gripper is not None:
                self.driver.gripper.called = loop.call

    def begin(self) -> None:
        if not self.node.parameters.headless:
            self._viewer = Viewer(self.model)
        self._period_ns = round(self.model.period * NS)
        self.node.lateness = LatenessRecorder(self._period_ns)
        self._last = 0

    def end(self) -> None:
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None

    def priority(self) -> int:
        # As fast as possible is no real time: it would keep a core from everything else.
        return 0 if self.node.parameters.pace == 'fast' else super().priority()

    def ticks(self) -> bool:
        return not self.paused

    # The loop

    def cycles(self) -> Loop:
        if self.node.parameters.pace == 'fast':
            return self._fast_loop()
        return (periodic(self._wall_tick, self._period_ns, self.node.clock)
                if self.compiled is None else self._without_interpreter(self.compiled))

    def _without_interpreter(self, loop: SimulatedLoop) -> Loop:
        """Let compiled code make the ticks; one that it does not make is made here."""
        node, numbers = self.node, loop.numbers
        commands, states, out = node.commands, node.control.states, node.state_out
        loop.begin(self._period_ns)
        while True:
            loop.may_go_on(self._only_goes_on)
            numbers[SEQUENCE], before = commands.sequence, int(out.written[0])
            numbers[MODE] = states.state.mode
            why = loop.run(node.control, self.driver, node.lateness)
            made = int(out.written[0]) - before
            if made:
                self._ticks += made
                commands.sequence = int(numbers[SEQUENCE])
                if not is_event(why):
                    node.control.catch_up()
            if why == CALLED:
                yield 0
                continue
            stamp = int(numbers[STAMP] - (numbers[LEFT] - 1) * numbers[PERIOD])
            if why == MESSAGE:
                commands.offer(loop.message, node.clock.wall())
            if why in (ASKED, MESSAGE, OTHER):
                self._advance(stamp, node.clock.wall())
            else:
                tick = end_tick(node.control, self.driver, why)
                self._ticks += 1
                out.publish(tick, stamp, commands.sequence)
            numbers[LEFT] -= 1
            self._sync_viewer()
            yield 0

    def _only_goes_on(self) -> bool:
        """Whether the next tick may be one that a kernel makes."""
        node = self.node
        other = (self.paused, not node.active, node.commands.asked, self._viewer,
                 self._hand_seen is not None)
        return not any(other) and only_goes_on(node.control, self.driver)

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        clock = self.node.clock
        self.node.lateness.add(deadline_ns, now_ns)
        # After an overrun, make up the missed periods: simulated time must keep up with wall time.
        periods = (deadline_ns - self._last) // self._period_ns if self._last else 1
        self._last = deadline_ns
        stamp = clock.wall() - (clock.now() - deadline_ns)
        for late in range(min(periods, MAX_CATCH_UP) - 1, -1, -1):
            # Not the time of the tick: a simulation that lags would call new references early.
            self._advance(stamp - late * self._period_ns, clock.wall())
        self._sync_viewer()

    def _fast_loop(self) -> Loop:
        clock, lateness = self.node.clock, self.node.lateness
        while True:
            simulated = round(self.model.time * NS)
            if not self._advance(simulated, simulated):
                yield clock.now() + PAUSED_NS
                continue
            self._clock_out.publish(ClockMessage(clock=stamp_of(round(self.model.time * NS))))
            now = clock.now()
            lateness.add(now, now)
            self._sync_viewer()
            yield now

    def _sync_viewer(self) -> None:
        if self._viewer is not None and self._ticks % VIEWER_EVERY == 0:
            self._viewer.sync()

    def _advance(self, stamp_ns: int, now_ns: int) -> bool:
        """
        Make a tick and publish it; False while paused.

        :param stamp_ns: time of the tick
        :param now_ns: present time, of the clock of the references
        """
        node, driver = self.node, self.driver
        node.commands.carry_out()
        if self.paused and self.steps_left == 0:
            node.state_out.repeat()
            return False
        node.commands.take_references(now_ns)
        self._poll_hand()
        tick = node.control.answer(driver.measure())
        self.model.advance()
        self._ticks += 1
        node.state_out.publish(tick, stamp_ns, node.commands.sequence)
        return True

    # Pause and steps

    def _on_pause(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        # Steps that are left are not made.
        self._steps_dropped += self.steps_left
        self.paused = request.data
        self._last_tick = self._ticks
        self.node.commands.called()
        reply.success = True
        reply.message = 'paused' if request.data else 'running'
        return reply

    async def _on_step(self, request: StepSimulation.Request, reply: StepSimulation.Response
                       ) -> StepSimulation.Response:
        try:
            if not self.node.active:
                raise ParameterError('the node is not active')
            self._request_steps(request.steps)
            seconds = request.steps * self.model.period + STEP_TIMEOUT_S
            await self.node.wait_until(lambda: self.steps_left == 0, 0.005, seconds)
            if self.steps_left:
                raise ParameterError(f'{self.steps_left} of {request.steps} steps were not '
                                     'made in time')
            if self._steps_dropped:
                raise ParameterError(f'{self._steps_dropped} of {request.steps} steps were '
                                     'not made: ~/set_pause was called')
            reply.success = True
        except ParameterError as error:
            reply.message = str(error)
        reply.time = self.model.time
        return reply

    def _request_steps(self, steps: int) -> None:
        """:raises ParameterError: if it is not paused, or is advancing already"""
        if not self.paused:
            raise ParameterError('the simulation is not paused: call ~/set_pause first')
        if not 1 <= steps <= MAX_STEPS:
            raise ParameterError(f'steps is {steps}, expected 1 to {MAX_STEPS}')
        if self.steps_left:
            raise ParameterError(f'{self.steps_left} steps are left of another request')
        self._steps_dropped = 0
        self._last_tick = self._ticks + steps

    @property
    def steps_left(self) -> int:
        """Ticks that are left of a request."""
        return max(0, self._last_tick - self._ticks)

    # The hand

    def _entered(self, before: State) -> None:
        """A hand guides the arm from now on, or does not any more."""
        if State.GUIDED in (before, self.node.control.states.state):
            self._hand_seen = None
            self.driver.release()

    def _on_hand(self, message: PoseStamped) -> None:
        self._hand_seen = message
        self.node.commands.called()

    def _poll_hand(self) -> None:
        hand, message, self._hand_seen = self.driver.hand, self._hand_seen, None
        if message is not None:
            self._take_hand(message)
        elif hand is not None and not hand.holds:
            # Without a hand, the mouse in the viewer may apply a force: do not reset it here.
            self.driver.release()

    def _take_hand(self, message: PoseStamped) -> None:
        """Hold the tool with a hand at a pose, or refuse it."""
        parameters = self.node.parameters
        try:
            pose = checked_pose(message, parameters.frame_id)
        except GdmpError as error:
            self._hand_problem = f'hand_pose refused: {error}'
            return
        self.driver.hand = Hand(pose, hand_settings(parameters), HAND_TIMEOUT_S)

    # Reports

    def activity(self) -> str:
        problem, self._hand_problem = self._hand_problem, ''
        if problem:
            self.node.get_logger().warning(problem, throttle_duration_sec=1.0)
        if self.paused:
            return 'paused'
        if self.node.control.states.state is State.GUIDED:
            hand = self.driver.hand
            return ('guided by hand' if hand is not None and hand.holds else
                    'waiting for a hand')
        return ''


def node() -> ArmNode:
    """Return the node ``panda_sim``."""
    return ArmNode(SimulatedArm())


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``panda_sim``."""
    return run([node], arguments)


if __name__ == '__main__':
    raise SystemExit(main())

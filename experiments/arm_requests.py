"""
Random sequences of requests, losses and transitions of an arm, beside a model of its page.

The model knows docs/nodes.md: which request is accepted in which state, and what follows. The arm
is simulated, with its controller, without ROS. In every tick it moves only in states that move,
within its limits, without a step of the torque, and the state that is reported is the one that
acts.
"""
from __future__ import annotations

from functools import partial
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import rule, RuleBasedStateMachine
import numpy as np

from experiments import sequences
from gdmp_ros.control.arm_states import Request, State
from gdmp_ros.control.identification import FrictionIdentification
from gdmp_ros.control.joint_motion import PostureMotion
from gdmp_ros.control.modes import StreamMode
from gdmp_ros.control.reference_check import Origin
from gdmp_ros.control.settings import ContactSettings, ControllerSettings, LimitSettings
from gdmp_ros.control.target import resting_target, TWIST
from gdmp_ros.errors import ParameterError, RefusedError
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.payload import Payload

DT = 1e-3
#: Ticks in a state that does not move after which the arm rests; it then moves less than this [m].
SETTLED, STILL_M = 1000, 5e-3
#: Additional ticks until the arm rests, after a push or a change of the payload.
DISTURBED = 1000
#: Longest time in which the arm comes to rest [ticks].
LONGEST_STOP = 450
#: Time for which `~/arm` holds [ticks].
ARMED = 10_000
_MOVES = ('following', 'stopping', 'moving', 'identifying')
_ACTIVE = ('holding', 'resting', *_MOVES, 'guided', 'compliant', 'fault')
_AT_REST = ('holding', 'resting', 'compliant')


def _but(*states: str) -> tuple[str, ...]:
    return tuple(state for state in _ACTIVE if state not in states)


#: By request: in which states it is accepted.
ACCEPTED = {
    Request.ARM: ('holding', 'resting', 'following', 'compliant'),
    Request.STOP: _ACTIVE, Request.COMPLY: _but('fault'), Request.GUIDE: _but('fault'),
    Request.RELEASE: _ACTIVE, Request.MOVE: (*_AT_REST, 'stopping'),
    Request.IDENTIFY: (*_AT_REST, 'stopping'), Request.RECOVER: ('fault',),
    Request.TOOL: (*_AT_REST, 'guided'), Request.PAYLOAD: _but('identifying', 'fault'),
    Request.REFILL: (*_AT_REST, 'guided', 'fault')}
#: By request: which state comes from which; others stay.
NEXT = {
    Request.ARM: {'compliant': 'holding'},
    Request.STOP: {**dict.fromkeys(('resting', *_MOVES), 'stopping'), 'guided': 'holding',
                   'compliant': 'holding'},
    Request.COMPLY: dict.fromkeys(_but('fault'), 'compliant'),
    Request.GUIDE: {**dict.fromkeys(('resting', *_MOVES), 'stopping'), 'holding': 'guided',
                    'compliant': 'guided'},
    Request.RELEASE: {'guided': 'holding'},
    Request.MOVE: dict.fromkeys(_AT_REST, 'moving'),
    Request.IDENTIFY: dict.fromkeys(_AT_REST, 'identifying'),
    Request.RECOVER: {'fault': 'holding'}, Request.TOOL: {'resting': 'holding'},
    Request.PAYLOAD: {}, Request.REFILL: {}}
#: What ends a motion: its stream is not followed again.
_ENDS_MOTION = (Request.STOP, Request.COMPLY, Request.GUIDE, Request.MOVE, Request.IDENTIFY)


class ArmRequests(RuleBasedStateMachine):
    """A simulated arm, a stream of references, and what the documentation says of them."""

    def __init__(self) -> None:
        super().__init__()
        self.loop = ClosedLoop(Arm(), ControllerSettings(
            contact=ContactSettings(collision_force=30.0)))
        self.limits = LimitSettings()
        # The stream: none, or its mode, where it is, how fast, and its last number.
        self.mode: StreamMode | None = None
        self.place, self.speed, self.sequence = np.empty(7), 0.0, 1_000_000
        # Ticks that the arm is still armed; whether the present motion may be followed.
        self.armed, self.may_follow = 0, False
        self.disturbed, self.loaded = 0, False
        self.torque: np.ndarray | None = None
        self.since, self.rested_at = 0, self.loop.arm.measure().pose.copy()

    @property
    def state(self) -> str:
        """As it is reported."""
        return self.loop.states.state.name.lower()

    def pass_ticks(self, count: int) -> None:
        """Let ticks pass; each holds what is promised."""
        for _ in range(count):
            if self.state == 'inactive':
                self.advance_stream(False)
                continue
            before = self.state
            self.advance_stream(True)
            self.armed -= 1
            if self.state == 'following' != before and before != 'resting':
                assert self.may_follow or self.armed > 0, 'it follows what it must not'
            tick = self.loop.tick()
            self.look(tick, before)

    def look(self, tick: Any, before: str) -> None:
        """What holds in every tick."""
        if self.torque is not None:
            step = np.abs(tick.torque - self.torque).max()
            assert step <= self.limits.torque_slew * DT * (1.0 + 1e-9), f'torque steps by {step}'
        self.torque = tick.torque.copy()
        fastest = self.loop.joints.fastest(self.limits.joint_speed)
        self.disturbed -= 1
        # The limit holds for what the arm does, not for what pushes it.
        if self.state not in ('guided', 'compliant') and self.disturbed < 0:
            assert (np.abs(tick.measurement.velocity) <= fastest).all(), 'too fast'
        if 'collision' in self.loop.states.reason:
            self.armed, self.may_follow = 0, False
        # A tick begins in a state, and may end in another one.
        assert tick.mode in (self.loop.states.state.mode, State[before.upper()].mode), (
            tick.mode, before)
        same = self.state == before and self.state not in (*_MOVES, 'guided', 'compliant')
        self.since = self.since + 1 if same else 0
        if self.since == SETTLED:
            self.rested_at = tick.measurement.pose.copy()
        if self.since > SETTLED:
            away = float(np.linalg.norm(tick.measurement.pose[:3] - self.rested_at[:3]))
            assert away < STILL_M, f'{self.state}: it moves by {away}'

    def advance_stream(self, active: bool) -> None:
        """The publisher of references goes on, whatever the arm does."""
        if self.mode is None:
            return
        if self.mode is StreamMode.STREAMING:
            self.place[1] += DT * self.speed
        target = resting_target(self.place)
        if self.mode is StreamMode.STREAMING:
            target[TWIST + 1] = self.speed
        self.sequence += 1
        guard = self.loop.controller.guard
        origin = Origin(guard.settings.frame, 0.0, self.sequence, self.mode)
        if active:
            guard.offer(target, origin)
        else:
            self.newest = target, origin

    def ask(self, request: Request, argument: Any = None) -> None:
        """Ask for something; it is accepted, or refused with a reason, as documented."""
        before = self.state
        accepted = before in ACCEPTED[request]
        try:
            self.loop.do(request, argument)
        except ParameterError as error:
            assert not accepted and str(error), (before, request, error)
            assert self.state == before
            return
        except RefusedError as error:
            # No hand guides an arm that does not rest yet, or whose payload is not what was said.
            assert request is Request.GUIDE and 'does not explain' in str(error)
            assert self.since < SETTLED or self.loaded, error
            assert self.state == 'holding'
            self.armed, self.may_follow = 0, False
            return
        assert accepted, (before, request)
        assert self.state == NEXT[request].get(before, before), (before, request, self.state)
        if request is Request.ARM:
            self.armed = ARMED
        elif request in _ENDS_MOTION:
            self.armed, self.may_follow = 0, False

    @rule(count=st.sampled_from([1, 20, 150, 800]))
    def tick(self, count: int) -> None:
        """Time passes."""
        self.pass_ticks(count)

    @rule(request=st.sampled_from([Request.ARM, Request.STOP, Request.COMPLY, Request.GUIDE,
                                   Request.RELEASE, Request.RECOVER, Request.REFILL]))
    def service(self, request: Request) -> None:
        """A service without an argument."""
        self.ask(request)
        self.pass_ticks(2)

    @rule(joint=st.integers(0, 6), angle=st.sampled_from([-0.2, 0.2]))
    def move_joints(self, joint: int, angle: float) -> None:
        """A joint is to move."""
        goal = self.loop.arm.measure().position.copy()
        goal[joint] = np.clip(goal[joint] + angle, self.loop.joints.lower[joint] + 0.05,
                              self.loop.joints.upper[joint] - 0.05)
        self.ask(Request.MOVE, PostureMotion(self.loop.joints, goal[None], 0.5))
        self.pass_ticks(1)

    @rule()
    def identify(self) -> None:
        """The friction is to be identified."""
        self.ask(Request.IDENTIFY, FrictionIdentification(
            self.loop.joints, self.loop.arm.chain, (0.4,), 0.1))
        self.pass_ticks(1)

    @rule(length=st.sampled_from([0.0, 0.1]))
    def set_tool(self, length: float) -> None:
        """Another tool."""
        self.ask(Request.TOOL, ToolTransform((0.0, 0.0, length)))
        self.since = 0
        self.pass_ticks(1)

    @rule(mass=st.sampled_from([0.0, 0.3]))
    def set_payload(self, mass: float) -> None:
        """Something else is said to be carried: it sags, or rises, a little."""
        self.ask(Request.PAYLOAD, Payload(mass))
        self.since, self.loaded = -DISTURBED, mass > 0.0
        self.pass_ticks(1)

    @rule(away=st.sampled_from([0.0, 0.01, 0.15]), speed=st.sampled_from([-0.03, 0.03]),
          rests=st.booleans())
    def stream(self, away: float, speed: float, rests: bool) -> None:
        """A new stream of references: a motion, or a place that is held."""
        self.place = self.loop.arm.measure().pose.copy()
        self.place[1] += away
        self.speed, self.sequence = speed, self.sequence + 1_000_000
        self.mode = StreamMode.HOLDING if rests else StreamMode.STREAMING
        near = away < 0.02 and self.state in (*_AT_REST, 'following', 'stopping')
        self.may_follow = near and not rests
        self.pass_ticks(1)

    @rule(mode=st.sampled_from([StreamMode.HOLDING, StreamMode.ENDED, None]))
    def end_stream(self, mode: StreamMode | None) -> None:
        """The stream rests, says that it has ended, or is lost."""
        self.mode = mode if self.mode is not None else None
        self.pass_ticks(1)

    @rule(force=st.sampled_from([0.0, 60.0]))
    def push(self, force: float) -> None:
        """A force acts on the tool for 30 ms."""
        self.loop.arm.push(np.array([0.0, force, 0.0, 0.0, 0.0, 0.0]))
        self.disturbed, self.since = DISTURBED, -DISTURBED
        self.pass_ticks(30)
        self.loop.arm.push(np.zeros(6))

    @rule()
    def fail(self) -> None:
        """Something breaks."""
        if self.state in ('inactive', 'fault'):
            return
        self.loop.controller.guard.fault('a test')
        assert self.state == 'fault' and self.loop.controller.tank.energy == 0.0
        self.pass_ticks(1)

    @rule(request=st.sampled_from([Request.STOP, Request.COMPLY, Request.GUIDE]))
    def arm_and_think_better_of_it(self, request: Request) -> None:
        """The arm is armed, then something else is asked for: a motion elsewhere is refused."""
        if self.state in ACCEPTED[Request.ARM]:
            self.ask(Request.ARM)
            self.ask(request)
            self.pass_ticks(LONGEST_STOP)
            if self.state == 'guided':
                self.ask(Request.RELEASE)
            self.stream(0.15, 0.03, False)
            self.pass_ticks(20)

    @rule(ticks=st.sampled_from([1, 1500]), begins=st.booleans())
    def deactivate_and_activate(self, ticks: int, begins: bool) -> None:
        """The node is deactivated, and activated again after a while; a motion may begin then."""
        if self.state != 'inactive':
            before = self.state
            self.loop.do(Request.DEACTIVATE)
            assert self.state == ('stopping' if before in ('resting', *_MOVES) else 'inactive')
            for _ in range(LONGEST_STOP):
                if self.state != 'inactive':
                    self.pass_ticks(1)
            assert self.state == 'inactive', self.state
            self.loop.states.end()
        if begins:
            self.stream(0.0, 0.03, False)
        self.pass_ticks(ticks)
        self.loop.activate()
        if self.mode is not None:
            self.loop.controller.guard.observe(*self.newest)
        assert self.state == 'holding'
        self.armed, self.may_follow, self.since, self.torque = 0, False, 0, None
        self.pass_ticks(3)

    def teardown(self) -> None:
        """At the end the arm can be stopped, and follows a motion that begins near it."""
        self.loop.arm.push(np.zeros(6))
        if self.state == 'inactive':
            self.loop.activate()
        self.mode = None
        if self.state == 'fault':
            self.ask(Request.RECOVER)
        self.ask(Request.STOP)
        self.since = -DISTURBED
        self.pass_ticks(1500)
        assert self.state == 'holding', self.state
        self.stream(0.0, 0.03, False)
        self.pass_ticks(100)
        assert self.state == 'following', self.loop.states.last_refusal


#: Try random sequences (`experiments.sequences.run`).
run = partial(sequences.run, ArmRequests, steps=20)

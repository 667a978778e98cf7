"""A simulated arm that is controlled, one tick at a time. No ROS."""
from __future__ import annotations

import numpy as np

from gdmp_ros.control.arm_control import ArmControl
from gdmp_ros.control.arm_states import State
from gdmp_ros.control.limits import LIMITS
from gdmp_ros.control.manipulability import (
    position_torque,
    PositionGains,
    PositionState,
    PositionTarget,
)
from gdmp_ros.control.measurement import Measurement, Tick
from gdmp_ros.control.plain_tick import controller_of, MADE, OTHER
from gdmp_ros.control.settings import ControllerSettings, LimitSettings
from gdmp_ros.control.torque_limits import TorqueLimiter
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.frames import ToolTransform
from gdmp_ros.sim.gripper import SimulatedGripper
from gdmp_ros.sim.payload import Payload
from gdmp_ros.sim.plain_tick import end_tick, follow_plainly, only_goes_on, robot_of
from gdmp_ros.sim.plant import act, channel_of, PlantSettings
from gdmp_ros.sim.teaching import Hand, NO_HAND, pull


class SimulatedDriver:
    """
    A simulated arm; see `gdmp_ros.control.arm_driver.ArmDriver`. Its torques always act.

    :ivar hand: the hand that pulls the tool, if any
    :ivar gripper: of the arm, if it has one
    """

    controlled, taken = True, None

    def __init__(self, arm: Arm, gripper: SimulatedGripper | None = None):
        self.arm, self.gripper = arm, gripper
        self.joints, self.friction, self.dt = arm.limits, arm.friction, arm.period
        self.chain, self.body = arm.chain, arm.shape
        self.hand: Hand | None = None
        # Compile what is called in a tick, or load it from the cache: this takes milliseconds.
        measured = arm.measure()
        pull(NO_HAND, arm.touched, measured.pose, np.zeros(6), self.dt)
        self.release()
        torque = measured.bias
        act(channel_of(PlantSettings(), len(torque), self.dt), torque, torque.copy())

    @property
    def others(self) -> np.ndarray:
        """Positions of what is not a joint of the arm: fingers, objects; empty without them."""
        return np.array(self.arm.data.qpos[len(self.joints.torque):])

    @property
    def end_pose(self) -> np.ndarray:
        return self.arm.end_pose

    def begin(self) -> Measurement:
        """Take its velocity away: as if its brakes had held it."""
        self.arm.rest()
        return self.arm.measure()

    def measure(self) -> Measurement:
        measured = self.arm.measure()
        if self.hand is not None:
            pull(self.hand.view, self.arm.touched, measured.pose,
                 measured.jacobian @ measured.velocity, self.dt)
        return measured

    def command(self, torque: np.ndarray) -> None:
        """Let a torque act; the simulation does not advance yet."""
        if self.gripper is not None:
            self.gripper.advance(self.dt)
        self.arm.act(torque)

    def end(self) -> None:
        pass

    def recover(self) -> Measurement:
        return self.begin()

    def release(self) -> None:
        """No hand pulls the tool."""
        self.hand = None
        self.arm.push(np.zeros(6))

    def reset(self, position: np.ndarray | None = None) -> Measurement:
        """:param position: of the joints [rad]; by default that of the first keyframe"""
        self.arm.reset(position)
        if self.gripper is not None:
            self.gripper.reset()
        self.release()
        return self.arm.measure()

    def use_tool(self, tool: ToolTransform) -> tuple[np.ndarray, np.ndarray]:
        before = self.arm.measure().pose
        self.arm.put_tool(tool)
        return before, self.arm.measure().pose

    def check_payload(self, state: State) -> None:
        """The model changes smoothly, in any state."""

    def carry(self, payload: Payload) -> None:
        self.arm.announce(payload)


class ClosedLoop(ArmControl):
    """
    A simulated arm and its impedance controller.

    :ivar arm: the arm
    """

    driver: SimulatedDriver

    def __init__(self, arm: Arm, settings: ControllerSettings | None = None,
                 gripper: SimulatedGripper | None = None):
        """Hold the arm at its home posture."""
        self.arm = arm
        super().__init__(SimulatedDriver(arm, gripper), settings)
        self.reset()

    def reset(self, position: np.ndarray | None = None) -> None:
        """
        Hold the arm at rest at ``position`` [rad], by default at its first keyframe.

        The next reference is taken for the first of a stream.
        """
        self.hold(self.driver.reset(position))
        self.controller.guard.forget_stream()

    def tick(self) -> Tick:
        """Measure, compute the torque and advance by one period."""
        result = self.act()
        self.arm.advance()
        return result

    def follow_all(self, references: np.ndarray) -> np.ndarray:
        """
        Follow references of the tool, one in each tick, without the interpreter where possible.

        :param references: shape (n, `gdmp_ros.control.target.TARGET_SIZE`)
        :returns: poses of the tool at the beginning of each tick, shape (n, 7)
        :raises RefusedError: if the guard does not accept one
        """
        references, poses, done = np.array(references), np.empty((len(references), 7)), 0
        while done < len(references):
            why = OTHER
            if only_goes_on(self, self.driver):
                made, why = follow_plainly(robot_of(self.driver), controller_of(self),
                                           self.driver.dt, references[done:], poses[done:])
                if made:
                    self.catch_up()
                done += made
            if done < len(references) and why == OTHER:
                self.must_follow(references[done])
                poses[done] = self.tick().measurement.pose
                done += 1
            elif why != MADE:
                end_tick(self, self.driver, why)
                done += 1
        return poses

    def act(self) -> Tick:
        """Measure, and let the torque act; the simulation does not advance yet."""
        return self.answer(self.driver.measure())


class PositionLoop:
    """An arm under position control, with its null space free for manipulability."""

    def __init__(self, arm: Arm, gains: PositionGains, torque_slew: float = 950.0):
        """:param torque_slew: largest rate of change of a joint torque [Nm/s]"""
        self.arm, self.gains = arm, gains
        self.limiter = TorqueLimiter(arm.limits, LimitSettings(torque_slew=torque_slew))
        self.limiter.reset(arm.measure().bias)
        self._violation = np.zeros(len(LIMITS))

    def tick(self, target: PositionTarget) -> PositionState:
        """Measure, compute and limit the torque, advance; returns the state before."""
        state = self.arm.linear_state(len(target.position))
        torque = position_torque(state, target, self.gains)
        self.arm.step(self.limiter.apply(self.arm.data.qpos, state.velocity, state.inertia,
                                         state.bias, torque, self.arm.period, self._violation))
        return state

    def settle(self, target: PositionTarget, seconds: float) -> None:
        """Hold a target for a time."""
        for _ in range(round(seconds / self.arm.period)):
            self.tick(target)

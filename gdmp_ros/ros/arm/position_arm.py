"""
An arm that takes joint positions, behind ros2_control or a robot's own driver.

It follows the same references as an arm with torques: an admittance answers to the wrench that a
sensor at its wrist measures (`gdmp_ros.control.admittance`).
"""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.control.admittance import AdmittanceSettings
from gdmp_ros.control.arm_states import State
from gdmp_ros.control.joint_path import CALLED
from gdmp_ros.control.measurement import Tick
from gdmp_ros.control.plain_tick import is_event, OTHER
from gdmp_ros.errors import DataError
from gdmp_ros.realtime.loop import Loop, NS, periodic
from gdmp_ros.realtime.native import LEFT, PERIOD, prepared
from gdmp_ros.realtime.statistics import LatenessRecorder
from gdmp_ros.ros.arm.backend import ArmBackend
from gdmp_ros.ros.arm.compiled_loop import ASKED, MESSAGE, MODE, SEQUENCE
from gdmp_ros.ros.arm.node import ArmNode
from gdmp_ros.ros.arm.parameters import POSITION
from gdmp_ros.ros.arm.position_link import TopicLink
from gdmp_ros.ros.arm.position_loop import (
    JOINTS,
    MOST_LATE,
    PositionArmLoop,
    RUNNING,
    warm_up,
    WRENCH,
)
from gdmp_ros.ros.parameters import settings_from
from gdmp_ros.ros.running import run
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.position_driver import PositionDriver
from gdmp_ros.sim.position_tick import UNUSABLE, view_of

#: Time in which the arm has to say where it is, and time between two looks [ns].
FIRST_NS, LOOK_NS = 15 * NS, 10_000_000


class PositionArm(ArmBackend):
    """
    An arm that takes joint positions.

    :ivar driver: of the arm
    :ivar link: to it
    :ivar compiled: loop that makes its ticks without the interpreter, if there is one
    """

    name, specs, described = 'position_arm', POSITION, True
    guiding = 'only what the sensor measures moves the arm: guide it by hand'
    driver: PositionDriver
    link: TopicLink
    compiled: PositionArmLoop | None = None
    _weighs = False

    def open(self) -> PositionDriver:
        node, p = self.node, self.node.parameters
        self.model = Arm(p.model, p.tool_site)
        sensor = (Arm(p.model, p.sensor_site) if p.wrench_topic else self.model).end_pose
        self.link = TopicLink(node, list(self.model.names))
        if not p.wrench_topic:
            node.get_logger().warning(
                'there is no sensor (wrench_topic): the arm follows stiffly, whatever the '
                'stiffness of its references')
        self._await()
        self.period = self.link.cycle
        self.driver = PositionDriver(self.model, self.link,
                                     settings_from(p, AdmittanceSettings), sensor)
        return self.driver

    def _await(self) -> None:
        """:raises DataError: if nothing tells where the arm is"""
        clock, link = self.node.clock, self.link
        latest = clock.now() + FIRST_NS
        while link.read() is None:
            if clock.now() > latest:
                raise DataError(link.problem or 'no joint states have arrived on '
                                f'{self.node.parameters.joint_states_topic}: is the arm on?')
            clock.sleep_until(clock.now() + LOOK_NS)

    def offer(self) -> None:
        node, commands = self.node, self.node.commands
        self.driver.use_memory(node.control.controller.numbers)
        loop = self.compiled = prepared(
            lambda: PositionArmLoop(commands.references, commands.reader, node.state_out,
                                    self.link),
            node.get_logger().info)
        if loop is not None:
            warm_up(node.control, self.link, view_of(self.driver))
            commands.called = loop.call

    def begin(self) -> None:
        self._period_ns = round(self.link.cycle * NS)
        self.node.lateness = LatenessRecorder(self._period_ns)
        self._last = 0
        self._weighs = True

    def cycles(self) -> Loop:
        return (periodic(self._wall_tick, self._period_ns, self.node.clock)
                if self.compiled is None else self._without_interpreter(self.compiled))

    def _without_interpreter(self, loop: PositionArmLoop) -> Loop:
        """Let compiled code make the ticks; one that it does not make is made here."""
        node, numbers = self.node, loop.numbers
        commands, control, out = node.commands, node.control, node.state_out
        loop.begin(self._period_ns)
        while True:
            loop.may_go_on(self._only_goes_on)
            numbers[SEQUENCE], before = commands.sequence, int(out.written[0])
            numbers[MODE] = control.states.state.mode
            why = loop.run(control, self.driver, node.lateness)
            if int(out.written[0]) != before:
                commands.sequence = int(numbers[SEQUENCE])
                # Also where the arm can be used no longer: it is held where it is now.
                if not is_event(why):
                    control.catch_up()
            now = node.clock.wall()
            if why == CALLED:
                pass
            elif why in (JOINTS, WRENCH, RUNNING):
                loop.hand_over(why, now)
            elif why >= UNUSABLE:
                control.fail(str(self.driver.stopped(why - UNUSABLE)))
                numbers[LEFT] = 0
            else:
                if why == MESSAGE:
                    commands.offer(loop.message, now)
                self.driver.dt = min(int(numbers[LEFT]), MOST_LATE) * int(numbers[PERIOD]) / NS
                if why in (ASKED, MESSAGE, OTHER):
                    self._tick(now)
                else:
                    tick = control.end_tick(why)
                    self.driver.command(tick.torque)
                    self._publish(tick, now)
                numbers[LEFT] = 0
            yield 0

    def _only_goes_on(self) -> bool:
        """Whether the next tick may be one that a kernel makes."""
        node = self.node
        return (node.active and not node.commands.asked and self.driver.controlled
                and node.control.only_goes_on)

    def _wall_tick(self, deadline_ns: int, now_ns: int) -> None:
        node, period = self.node, self._period_ns
        node.lateness.add(deadline_ns, now_ns)
        passed = (deadline_ns - self._last) // period if self._last else 1
        self._last, self.driver.dt = deadline_ns, min(passed, MOST_LATE) * period / NS
        self._tick(node.clock.wall())

    def _tick(self, stamp: int) -> None:
        """
        Make a tick and publish it.

        :param stamp: wall time [ns]
        """
        node = self.node
        node.commands.carry_out()
        measured = node.control.wait()
        if measured is None:
            return
        node.commands.take_references(stamp)
        self._publish(node.control.answer(measured), stamp)

    def _publish(self, tick: Tick, stamp: int) -> None:
        self.node.state_out.publish(self.driver.reported(tick), stamp,
                                    self.node.commands.sequence)

    def speed(self) -> float:
        return self.link.speed()

    def activity(self) -> str:
        if self.link.problem:
            self.node.get_logger().warning(self.link.problem, throttle_duration_sec=1.0)
            self.link.problem = ''
        if self._weighs and self.node.control.states.state is State.HOLDING:
            self._weighs, doubt = False, self.driver.weight_doubt()
            if doubt:
                self.node.get_logger().warning(doubt)
        return ''

    def diagnosed(self) -> dict[str, Any]:
        force = float(np.linalg.norm(self.driver.wrench[:3]))
        return {'delay of the arm [ms]': f'{1e3 * self.driver.delay:.1f}',
                'external force [N]': f'{force:.1f}'}


def node() -> ArmNode:
    """Return the node ``position_arm``."""
    return ArmNode(PositionArm())


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``position_arm``."""
    return run([node], arguments)


if __name__ == '__main__':
    raise SystemExit(main())

"""What a trajectory server says of itself: state, path to come, diagnostics, log lines."""
from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ServerState
from geometry_msgs.msg import Pose
from nav_msgs.msg import Path as PathMessage
import numpy as np

from gdmp_ros.realtime.statistics import Punctuality
from gdmp_ros.ros import messages as wire
from gdmp_ros.ros.lifecycle import lateness_diagnostics

if TYPE_CHECKING:
    from gdmp_ros.ros.server.node import TrajectoryServer

#: Poses of the path to come in one duration of the motion, and reports between two such paths.
PLAN_POSES, PLAN_EVERY = 40, 5
#: Reports between two looks who publishes references.
STREAMING_EVERY = 10
#: The state shows the rate and lateness of so many ticks.
WINDOW = 1000


class ServerReport:
    """``~/state``, ``~/plan``, ``/diagnostics``, and what the tick has noticed."""

    def __init__(self, server: TrajectoryServer):
        self._server = server
        self._state = server.add_publisher(ServerState, '~/state', 10)
        self._plan = server.add_publisher(PathMessage, '~/plan', 1)
        self._diagnostics = server.add_publisher(DiagnosticArray, '/diagnostics', 10)
        # The tick appends, the report logs: a log line takes longer than a tick may.
        self._stalls: deque[float] = deque(maxlen=10)
        self._refusals: deque[str] = deque(maxlen=10)
        self._reports = 0
        self._planned = False
        self._streaming: list[str] = []

    def stalled(self, seconds: float) -> None:
        """Note that the time jumped; any thread may."""
        self._stalls.append(seconds)

    def refused(self, reason: str) -> None:
        """Note that a message was refused; any thread may."""
        self._refusals.append(reason)

    def state(self, figures: Punctuality | None = None) -> ServerState:
        """Describe the present state."""
        server = self._server
        figures = figures or server.lateness.punctuality(WINDOW)
        message = ServerState(status='idle', skill=server.skill_name)
        message.header.stamp = server.get_clock().now().to_msg()
        message.header.frame_id = server.parameters.frame_id
        message.ticks, message.missed = server.lateness.ticks, server.lateness.missed
        message.rate_hz = figures.rate_hz
        message.lateness_p50_us, message.lateness_p99_us = figures.p50_us, figures.p99_us
        message.lateness_max_us = figures.max_us
        message.scheduler = server.thread.scheduler if server.thread is not None else 'other'
        flags = set() if server.robot_is_met() else {'no_robot'}
        message.flags = sorted(flags)
        player = server.player
        if player is None:
            return message
        message.status, message.refused = player.status, player.refused
        message.goal = [Pose()]
        wire.set_pose(message.goal[0], player.goal())
        message.last_refusal = player.last_refusal
        rollout = player.rollout
        if rollout is not None:
            manifold = rollout.skill.manifold
            message.progress, message.speed = rollout.progress, rollout.speed
            message.phase = float(np.exp(-rollout.skill.gains.alpha_x * rollout.progress))
            message.finished = rollout.finished
            message.factors = list(manifold.names)
            message.distance_to_goal = player.distances()
            message.flags = sorted(flags | rollout.flags)
        return message

    def publish(self) -> ServerState:
        """Publish everything; the state that was published."""
        self._reports += 1
        self._log()
        self._publish_plan()
        figures = self._server.lateness.punctuality(WINDOW)
        message = self.state(figures)
        self._state.publish(message)
        self._publish_diagnostics(message, figures)
        return message

    def _log(self) -> None:
        logger = self._server.get_logger()
        while self._stalls:
            logger.warning(f'the time jumped by {self._stalls.popleft():.3f} s: the motion goes '
                           'on from where it was')
        if self._refusals:
            logger.warning(self._refusals[-1], throttle_duration_sec=1.0)
            self._refusals.clear()

    def _publish_plan(self) -> None:
        """Publish the path to come where somebody looks at it, and once more when it is over."""
        player = self._server.player
        if player is None or self._plan.get_subscription_count() == 0:
            return
        poses = player.to_come(PLAN_POSES)
        if poses is None and self._planned and player.status == 'holding':
            poses = np.empty((0, 7))
        if poses is not None:
            self._planned = len(poses) > 0
            self._plan.publish(wire.path_message(poses, self._server.parameters.frame_id,
                                                 self._server.get_clock().now().to_msg()))
        if player.status in ('moving', 'paused') and self._reports % PLAN_EVERY == 0:
            player.look_ahead()

    def _publish_diagnostics(self, message: ServerState, figures: Punctuality) -> None:
        server, thread = self._server, self._server.thread
        level, text = DiagnosticStatus.OK, message.status
        if thread is not None and thread.failure is not None:
            level, text = DiagnosticStatus.ERROR, f'streaming failed: {thread.failure!r}'
            server.get_logger().error(text, throttle_duration_sec=5.0)
        elif message.flags:
            level, text = DiagnosticStatus.WARN, f'{message.status}: {", ".join(message.flags)}'
        if self._reports % STREAMING_EVERY == 0:
            self._streaming = server.publishers('~/reference')
        if len(self._streaming) > 1:
            level = max(level, DiagnosticStatus.WARN)
            text = (f'{text}; {len(self._streaming)} nodes publish references: '
                    f'{", ".join(self._streaming)}')
            server.get_logger().warning(text, throttle_duration_sec=5.0)
        extra = {'skill': message.skill, 'refused': message.refused,
                 'last refusal': message.last_refusal, 'scheduler': message.scheduler}
        self._diagnostics.publish(lateness_diagnostics(
            server.get_fully_qualified_name().strip('/'), level, text, figures, extra,
            message.header.stamp))

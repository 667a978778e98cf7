"""What a trajectory server reports: state, predicted path, diagnostics, log messages."""
from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ServerState
from geometry_msgs.msg import Pose
from nav_msgs.msg import Path as PathMessage
import numpy as np

from gdmp_ros.playback.player import Player
from gdmp_ros.playback.prediction import predicted_poses
from gdmp_ros.playback.requests import Status
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.realtime.statistics import Punctuality
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.messages import lateness_diagnostics, path_message, set_pose

#: Poses of a predicted path in one duration of the motion.
PLAN_POSES = 40
#: Reports between two predicted paths.
PLAN_EVERY = 5
#: Reports between two diagnostics without a change, and between two checks of the publishers.
DIAGNOSTICS_EVERY = 10
#: Reports between two evaluations of rate and lateness, and number of ticks for them.
FIGURES_EVERY, WINDOW = 10, 1000


class ServerReport:
    """``~/state``, ``~/plan``, ``/diagnostics`` and log messages."""

    def __init__(self, node: ManagedNode, streamer: Streamer, frame: str):
        """:param frame: ``frame_id`` of state and path"""
        self._node, self._streamer, self._frame = node, streamer, frame
        self._state = node.add_publisher(ServerState, '~/state', 10)
        self._plan = node.add_publisher(PathMessage, '~/plan', 1)
        self._diagnostics = node.add_publisher(DiagnosticArray, '/diagnostics', 10)
        self._reports = 0
        self._figures = streamer.lateness.punctuality(WINDOW)
        self._plan_is_shown = False
        self._publishers: list[str] = []
        self._last_diagnosis: tuple[bytes, str] | None = None

    def state(self) -> ServerState:
        """The present state."""
        streamer, figures = self._streamer, self._figures
        lateness, member = streamer.lateness, streamer.member
        message = ServerState(
            status=Status.IDLE, skill=streamer.skill_name, ticks=lateness.ticks,
            missed=lateness.missed, rate_hz=figures.rate_hz, lateness_p50_us=figures.p50_us,
            lateness_p99_us=figures.p99_us, lateness_max_us=figures.max_us,
            scheduler=member.scheduler if member is not None else 'other',
            refused=streamer.refusals.count, last_refusal=streamer.refusals.last)
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.header.frame_id = self._frame
        flags = set() if streamer.robot_is_known() else {'no_robot'}
        if streamer.player is not None:
            flags |= _add_motion(message, streamer.player)
        message.flags = sorted(flags)
        return message

    def publish(self) -> ServerState:
        """Publish everything, and return the state that was published."""
        self._reports += 1
        self._log()
        self._publish_plan()
        if self._reports % FIGURES_EVERY == 1:
            self._figures = self._streamer.lateness.punctuality(WINDOW)
        message = self.state()
        self._state.publish(message)
        self._publish_diagnostics(message, self._figures)
        return message

    def _log(self) -> None:
        # Not logged in the tick: a log message can take longer than a period.
        logger, time_jumps = self._node.get_logger(), self._streamer.time_jumps
        while time_jumps:
            logger.warning(f'the time jumped by {time_jumps.popleft():.3f} s: the motion did not '
                           'advance')
        reasons = self._streamer.refusals.take_new()
        if reasons:
            logger.warning(f'refused: {reasons[-1]}', throttle_duration_sec=1.0)

    def _publish_plan(self) -> None:
        """Publish the predicted path if there are subscribers, and an empty one at the end."""
        player = self._streamer.player
        if player is None or self._plan.get_subscription_count() == 0:
            return
        rollout, poses = player.taken_copy(), None
        if rollout is not None:
            poses = predicted_poses(rollout, PLAN_POSES)
        elif self._plan_is_shown and player.status is Status.HOLDING:
            poses = np.empty((0, 7))
        if poses is not None:
            self._plan_is_shown = len(poses) > 0
            self._plan.publish(path_message(poses, self._frame,
                                            self._node.get_clock().now().to_msg()))
        if (player.status in (Status.MOVING, Status.PAUSED)
                and self._reports % PLAN_EVERY == 0):
            player.request_copy()

    def _publish_diagnostics(self, message: ServerState, figures: Punctuality) -> None:
        node, member = self._node, self._streamer.member
        level, text = DiagnosticStatus.OK, message.status
        if member is not None and member.failure is not None:
            level, text = DiagnosticStatus.ERROR, f'streaming failed: {member.failure!r}'
            node.get_logger().error(text, throttle_duration_sec=5.0)
        elif message.flags:
            level, text = DiagnosticStatus.WARN, f'{message.status}: {", ".join(message.flags)}'
        if self._reports % DIAGNOSTICS_EVERY == 0:
            self._publishers = node.publishers('~/reference')
        if len(self._publishers) > 1:
            level = max(level, DiagnosticStatus.WARN)
            text = (f'{text}; {len(self._publishers)} nodes publish references: '
                    f'{", ".join(self._publishers)}')
            node.get_logger().warning(text, throttle_duration_sec=5.0)
        if self._reports % DIAGNOSTICS_EVERY and (level, text) == self._last_diagnosis:
            return
        self._last_diagnosis = (level, text)
        extra = {'skill': message.skill, 'refused': message.refused,
                 'last refusal': message.last_refusal, 'scheduler': message.scheduler}
        self._diagnostics.publish(lateness_diagnostics(
            node.get_fully_qualified_name().strip('/'), level, text, figures, extra,
            message.header.stamp))


def _add_motion(message: ServerState, player: Player) -> set[str]:
    """Write what belongs to the player, and return the flags of its motion."""
    message.status = player.status
    message.goal = [Pose()]
    set_pose(message.goal[0], player.goal)
    rollout = player.rollout
    if rollout is None:
        return set()
    message.progress, message.speed = rollout.progress, rollout.speed
    message.phase = float(np.exp(-rollout.skill.gains.alpha_x * rollout.progress))
    message.finished = rollout.finished
    message.factors = list(rollout.skill.manifold.names)
    message.distance_to_goal = player.distances()
    return rollout.flags

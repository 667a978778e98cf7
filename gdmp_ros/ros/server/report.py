"""What a trajectory server reports: state, predicted path, diagnostics, log messages."""
from __future__ import annotations

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from gdmp_msgs.msg import ArmStatus, Context, ServerState
from gdmp_msgs.msg import Tube as TubeMessage
from nav_msgs.msg import Path as PathMessage
import numpy as np

from gdmp_ros.control.modes import ArmMode
from gdmp_ros.dmp.primitive import Primitive
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.poses import POSE_SIZE
from gdmp_ros.playback.player import Player
from gdmp_ros.playback.prediction import prediction, Tube
from gdmp_ros.playback.states import Status
from gdmp_ros.playback.streamer import Streamer
from gdmp_ros.realtime.loop import NS
from gdmp_ros.realtime.statistics import Punctuality
from gdmp_ros.ros.lifecycle import DIAGNOSTICS_EVERY, ManagedNode
from gdmp_ros.ros.messages import lateness_diagnostics, path_message, pose_message, tube_message

#: Poses of a predicted path in one duration of the motion.
PLAN_POSES = 40
#: Reports between two predicted paths.
PLAN_EVERY = 5
#: Reports between two evaluations of rate and lateness, and number of ticks for them.
FIGURES_EVERY, WINDOW = 10, 1000
#: Parts of the rate that is asked for, below which there is a warning, and an error.
ENOUGH, LEAST = 0.99, 0.95
#: Shorter jumps are messages on /clock that were lost; nothing to act on [s].
NOTABLE_JUMP_S = 0.05
#: Oldest status of the arm that counts [s].
ARM_S = 1.0


class ServerReport:
    """``~/state``, ``~/plan``, ``~/tube``, ``/diagnostics`` and log messages."""

    def __init__(self, node: ManagedNode, streamer: Streamer, frame: str, arm_topic: str):
        """
        Prepare to report.

        :param frame: ``frame_id`` of state and path
        :param arm_topic: topic of the status of the arm
        """
        self._arm: tuple[ArmStatus, int] | None = None
        # Polled: for each message an executor takes half a millisecond.
        self._arm_in = node.add_subscription(ArmStatus, arm_topic, None)
        self._node, self._streamer, self._frame = node, streamer, frame
        self._state = node.add_publisher(ServerState, '~/state', 10)
        self._plan = node.add_publisher(PathMessage, '~/plan', 1)
        self._tube_out = node.add_publisher(TubeMessage, '~/tube', 1)
        self._tube: tuple[Primitive, Tube] | None = None
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
        message.header.stamp = self._node.stamp()
        message.header.frame_id = self._frame
        message.context = Context(names=list(streamer.context),
                                  values=list(streamer.context.values()))
        flags = set() if streamer.robot_is_known() else {'no_robot'}
        if streamer.player is not None:
            flags |= _add_motion(message, streamer.player) | streamer.robot.flags
            flags |= {'object_lost'} if streamer.objects.lost else set()
            measured, player = streamer.robot.place, streamer.player
            if measured is not None and measured.shape == player.goal.shape:
                message.robot_distance = list(player.playing.distance(measured, player.goal))
            message.goal.extend(pose_message(pose) for pose in self._poses_at(player.goal))
        sequence = streamer.sequence.status
        if sequence is not None and sequence.running:
            message.sequence, message.step_name = sequence.name, sequence.step_name
            message.step, message.steps = sequence.step, sequence.steps
        message.flags = sorted(flags | self._arm_flags(message.status == Status.MOVING))
        return message

    @property
    def arm(self) -> ArmStatus | None:
        """What the arm said last; None if that is too old."""
        if self._arm is None or self._node.clock.now() - self._arm[1] > ARM_S * NS:
            return None
        return self._arm[0]

    def _arm_flags(self, moving: bool) -> set[str]:
        arm = self.arm
        if arm is None:
            return set()
        flags = {'tank_low'} if arm.tank_low else set()
        if moving and arm.mode not in (ArmMode.FOLLOW, ArmMode.UNKNOWN):
            flags.add('not_followed')
        return flags

    def publish(self) -> ServerState:
        """Publish everything, and return the state that was published."""
        self._reports += 1
        status = self._arm_in.newest_message()
        if status is not None:
            self._arm = status, self._node.clock.now()
        # What slows the arm slows the motion, so that it does not run ahead.
        scale = 1.0 if self.arm is None else self.arm.scale
        self._streamer.bounds.allow(scale if 0.0 <= scale <= 1.0 else 1.0)
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
            jump = time_jumps.popleft()
            text = f'the time jumped by {jump:.3f} s: the motion did not advance'
            if abs(jump) > NOTABLE_JUMP_S:
                logger.warning(text)
            else:
                logger.debug(text)
        reasons = self._streamer.refusals.take_new()
        if reasons:
            logger.warning(f'refused: {reasons[-1]}', throttle_duration_sec=1.0)

    def _publish_plan(self) -> None:
        """Publish path and tube if there are subscribers, and empty ones at the end."""
        player = self._streamer.player
        if player is None or not (self._plan.subscribers() or self._tube_out.subscribers()):
            return
        rollout, stamp = player.taken_copy(), self._node.stamp()
        if rollout is not None:
            points, progress = prediction(rollout, PLAN_POSES)
            # Of two arms the path of the first one is shown.
            poses = np.concatenate([self._poses_at(player.playing.place_of(point))[:1]
                                    for point in points])
            self._plan_is_shown = True
            self._plan.publish(path_message(poses, self._frame, stamp))
            self._publish_tube(rollout.skill, poses, progress, stamp)
        elif self._plan_is_shown and player.status is Status.HOLDING:
            self._plan_is_shown = False
            self._plan.publish(path_message(np.empty((0, 7)), self._frame, stamp))
            self._tube_out.publish(tube_message(np.empty((0, 7)), np.empty((0, 6, 6)), self._frame,
                                                stamp))
        if player.status in (Status.MOVING, Status.PAUSED) and self._reports % PLAN_EVERY == 0:
            player.request_copy()

    def _poses_at(self, place: np.ndarray) -> np.ndarray:
        """Poses of the tools at a place, shape ``(n, 7)``; none if they are not known."""
        kinematics = self._streamer.kinematics
        if not self._streamer.joints:
            return place.reshape(-1, POSE_SIZE)
        if kinematics is None:
            return np.empty((0, POSE_SIZE))
        return kinematics.pose_at(place)[None]

    def _publish_tube(self, skill: Primitive, poses: np.ndarray, progress: np.ndarray, stamp: Time
                      ) -> None:
        if (not isinstance(skill, Skill) or skill.variation is None
                or self._tube_out.subscribers() == 0 or self._streamer.joints):
            return
        if self._tube is None or self._tube[0] is not skill:
            self._tube = skill, Tube(skill, PLAN_POSES)
        self._tube_out.publish(tube_message(poses, self._tube[1].covariances(progress),
                                            self._frame, stamp))

    def _publish_diagnostics(self, message: ServerState, figures: Punctuality) -> None:
        node, member = self._node, self._streamer.member
        level, text = DiagnosticStatus.OK, message.status
        failure = self._streamer.failure
        if failure is not None:
            level, text = DiagnosticStatus.ERROR, f'streaming failed: {failure!r}'
            node.get_logger().error(text, throttle_duration_sec=5.0)
        elif message.flags:
            level, text = DiagnosticStatus.WARN, f'{message.status}: {", ".join(message.flags)}'
        share = figures.rate_hz / self._streamer.lateness.rate_hz
        if member is not None and figures.ticks >= WINDOW and share < ENOUGH:
            level = max(level, DiagnosticStatus.ERROR if share < LEAST else DiagnosticStatus.WARN)
            text = (f'{text}; {figures.rate_hz:.1f} Hz of '
                    f'{self._streamer.lateness.rate_hz:g} Hz')
        if self._reports % DIAGNOSTICS_EVERY == 0:
            self._publishers = node.participant.publishers('~/reference')
        if len(self._publishers) > 1:
            level = max(level, DiagnosticStatus.WARN)
            text = (f'{text}; {len(self._publishers)} nodes publish references: '
                    f'{", ".join(self._publishers)}')
            node.get_logger().warning(text, throttle_duration_sec=5.0)
        if self._reports % DIAGNOSTICS_EVERY and (level, text) == self._last_diagnosis:
            return
        self._last_diagnosis = (level, text)
        extra = {'skill': message.skill, 'refused': message.refused,
                 'last refusal': message.last_refusal,
                 'references bounded': self._streamer.bounds.bounded,
                 'time jumps': self._streamer.jumps,
                 'scheduler': message.scheduler}
        self._diagnostics.publish(lateness_diagnostics(
            node.get_fully_qualified_name().strip('/'), level, text, figures, extra,
            message.header.stamp))


def _add_motion(message: ServerState, player: Player) -> set[str]:
    """Write what belongs to the player, and return the flags of its motion."""
    message.status = player.status
    rollout = player.rollout
    if rollout is None:
        return set()
    message.progress, message.speed = rollout.progress, rollout.speed
    if not rollout.skill.rhythmic:
        # Beyond its end a motion follows its goal.
        message.progress = min(message.progress, 1.0)
    message.phase = rollout.phase
    message.rhythmic = rollout.skill.rhythmic
    message.amplitude, message.frequency = rollout.amplitude, rollout.frequency
    message.finished = rollout.finished
    message.factors = list(rollout.skill.manifold.names)
    message.distance_to_goal = player.distances()
    return rollout.flags

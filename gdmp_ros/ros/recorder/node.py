"""Records takes of a demonstration; services start, pause, stop and discard them."""
from __future__ import annotations

from collections.abc import Callable
import os
from pathlib import Path
import shutil
from typing import Any

from gdmp_msgs.msg import RecorderState
from std_srvs.srv import SetBool, Trigger

from gdmp_ros.choices import STORAGES
from gdmp_ros.data import takes
from gdmp_ros.errors import DataError, GdmpError, ParameterError
from gdmp_ros.realtime.loop import NS
from gdmp_ros.ros.lifecycle import ManagedNode
from gdmp_ros.ros.parameters import Parameters, Spec
from gdmp_ros.ros.recorder.record import DRAIN_S, message_class, Tap
from gdmp_ros.ros.recorder.take import Take
from gdmp_ros.ros.running import run

SPECS = (
    Spec('autostart', True, 'configure and activate at start-up'),
    Spec('folder', 'takes', 'folder for the takes, one bag each'),
    Spec('prefix', 'take', 'takes are named PREFIX_001, PREFIX_002, …'),
    Spec('storage', 'mcap', 'storage format of the bags', choices=STORAGES),
    Spec('pose_topic', '/panda_sim/measured_pose', 'geometry_msgs/PoseStamped of the tool'),
    Spec('also', [''], 'more topics to record, as TOPIC=package/msg/Type'),
    Spec('transforms', False, 'record /tf and /tf_static, too: where objects are, for skills with '
         'task frames'),
    Spec('rare', ['gripper/command=gdmp_msgs/msg/GripperCommand'], 'topics with a message now and '
         'then, as TOPIC=package/msg/Type; a take need not have one'),
    Spec('longest', 600.0, 'a take ends after this time', 's', 1.0, 86400.0),
    Spec('keep_free', 64.0, 'a take ends if the disk has less free space', 'MB', 1.0, 1e6),
)
POSE = 'geometry_msgs/msg/PoseStamped'
TF, TF_STATIC, TRANSFORMS = '/tf', '/tf_static', 'tf2_msgs/msg/TFMessage'


class TakeRecorder(ManagedNode):
    """The managed node ``take_recorder``."""

    def __init__(self) -> None:
        super().__init__('take_recorder')
        self.parameters = Parameters(self, SPECS)
        self._tap: Tap | None = None
        self._take: Take | None = None
        self._kept: Path | None = None
        self._state = RecorderState(status='waiting')

    def configure(self) -> None:
        self._state, self._kept = RecorderState(status='waiting'), None
        self._folder = Path(self.parameters.folder).expanduser().absolute()
        _check_folder(self._folder)
        self._pose_topic = self.resolve_topic_name(self.parameters.pose_topic)
        self._rare = self._named('rare')
        self._transforms = [TF, TF_STATIC] if self.parameters.transforms else []
        self._topics = {self._pose_topic: POSE, **self._named('also'), **self._rare,
                        **dict.fromkeys(self._transforms, TRANSFORMS)}
        self._publisher = self.add_publisher(RecorderState, '~/state', 10)
        for name, action in (('start', self.start), ('stop', self.stop),
                             ('discard', self.discard)):
            self.add_service(Trigger, name, self._answering(action))
        self.add_service(SetBool, 'pause', self._on_pause)
        self.add_report(self._report)
        self.parameters.locked = True

    def activate(self) -> None:
        # Publishers of /tf may be of either kind.
        self._tap = Tap(self.participant, self._topics, best_effort=[TF],
                        rare=[*self._rare, *self._transforms], lasting=[TF_STATIC])
        self._timer = self.participant.timer(DRAIN_S, self._drain)
        self.get_logger().info(
            f'takes are written to {self._folder}, topics: {", ".join(self._topics)}')

    def deactivate(self) -> None:
        if self._tap is None:
            return
        try:
            if self._take is not None:
                self._finish('the recorder was deactivated')
        except (GdmpError, OSError) as error:
            self.get_logger().error(str(error))
        finally:
            self.participant.destroy(self._timer)
            self._tap.release()
            self._tap = None

    def _named(self, name: str) -> dict[str, str]:
        """Topics and their types in a parameter."""
        result = {}
        for pair in filter(None, getattr(self.parameters, name)):
            topic, _, kind = pair.partition('=')
            try:
                message_class(kind)
            except (ValueError, ImportError, AttributeError):
                raise ParameterError(f'{name} has {pair!r}, expected TOPIC=package/msg/Type of an '
                                     'installed package') from None
            result[self.resolve_topic_name(topic)] = kind
        return result

    def takes(self) -> list[str]:
        """Names of all takes in the folder."""
        return sorted(path.parent.name for path in self._folder.glob('*/metadata.yaml'))

    def start(self) -> str:
        """Start a take; returns a message for the user."""
        if self._tap is None:
            raise ParameterError('the recorder is not active: activate it first')
        if self._take is not None:
            raise ParameterError(f'{self._state.take} is being recorded: stop or discard it first')
        name = takes.next_name(self._folder, self.parameters.prefix)
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f'{self._folder}: cannot write takes: {error.strerror}') from None
        self._tap.begin()
        self._take = Take(self._folder / name, self.parameters.storage, self._pose_topic,
                          self._rare)
        self._tap.repeat(self._take, self.time_ns())
        self._begun = self.clock.now()
        self._state.take, self._state.messages, self._state.problem = name, 0, ''
        return f'recording {name}'

    def pause(self) -> str:
        """Record nothing until `resume`; commands of a gripper are kept."""
        if self._take is None or self._take.paused:
            raise ParameterError('no take is being recorded' if self._take is None else
                                 f'{self._state.take} is paused already')
        self._drain()  # what has come belongs to the take
        if self._take is None:
            raise ParameterError(f'the take has ended: {self._state.problem}')
        self._take.pause()
        return f'{self._state.take} is paused: go on near this pose'

    def resume(self) -> str:
        """Go on with a take that is paused; its bag has no gap."""
        if self._take is None or not self._take.paused:
            raise ParameterError('no take is paused')
        self._drain()
        if self._take is None:
            raise ParameterError(f'the take has ended: {self._state.problem}')
        self._take.resume()
        return f'recording {self._state.take} again'

    def stop(self) -> str:
        """Stop the take and keep it."""
        if self._take is None:
            raise ParameterError('nothing is being recorded: start a take first')
        return self._finish('')

    def discard(self) -> str:
        """Delete the take that is being recorded, or else move the last one to ``dropped``."""
        if self._take is not None:
            take, self._take = self._take, None
            take.close(keep=False)
            return f'discarded {take.path.name} while it was being recorded'
        if self._kept is None or not self._kept.exists():
            raise ParameterError('there is no take of this session to discard; move older '
                                 'ones with gdmp takes FOLDER --drop NAME')
        kept, self._kept = self._kept, None
        return f'moved to {takes.drop(kept.parent, kept.name)}'

    def _finish(self, problem: str) -> str:
        """Close the take that is being recorded; a take without messages is not kept."""
        take, tap, self._take = self._take, self._tap, None
        if take is None or tap is None:
            return ''
        try:
            tap.drain(take)
            self._state.messages = take.count
        finally:
            # After an error, too, what was written is kept.
            take.close(keep=take.count > 0)
        missing = ', '.join(sorted(tap.waiting))
        if missing:
            problem = f'{problem}; no message on {missing}'.strip('; ')
        if not self._state.messages:
            raise DataError(f'{self._state.take} is not kept: {problem}')
        self._kept = take.path
        self._state.problem = problem
        text = (f'{take.path}: {self._state.messages} messages in {self._state.duration:.1f} s'
                + (f'; {problem}' if problem else ''))
        self.get_logger().info(text)
        return text

    def _drain(self) -> None:
        take, tap = self._take, self._tap
        if tap is None or take is None:
            return
        if take.paused:
            self._begun = self.clock.now() - round(self._state.duration * NS)
        self._state.duration = (self.clock.now() - self._begun) / NS
        try:
            tap.drain(take)
            self._state.messages = take.count
            free = shutil.disk_usage(self._folder).free
            if free < self.parameters.keep_free * 1e6:
                self._finish(f'the disk is nearly full ({free / 1e6:.0f} MB free)')
            elif self._state.duration > self.parameters.longest:
                self._finish(f'a take lasts at most {self.parameters.longest:g} s')
        except (GdmpError, OSError) as error:
            self._state.problem = str(error)
            self.get_logger().error(str(error), throttle_duration_sec=1.0)

    def _report(self) -> None:
        if self._tap is None:
            return
        if self._take is None:
            self._tap.drain(None)
        state = self._state
        state.header.stamp = self.stamp()
        state.folder, state.takes = str(self._folder), self.takes()
        state.status = ('paused' if self._take is not None and self._take.paused
                        else 'recording' if self._take is not None
                        else 'waiting' if self._tap.waiting else 'ready')
        self._publisher.publish(state)

    def _on_pause(self, request: SetBool.Request, reply: SetBool.Response) -> SetBool.Response:
        return self._answering(self.pause if request.data else self.resume)(request, reply)

    def _answering(self, action: Callable[[], str]) -> Callable[[Any, Any], Any]:
        def answer(_: Any, reply: Any) -> Any:
            try:
                reply.success, reply.message = True, action()
            except (GdmpError, OSError) as error:
                reply.success, reply.message = False, str(error)
                self.get_logger().warning(reply.message)
            return reply
        return answer


def _check_folder(folder: Path) -> None:
    """:raises DataError: if a folder that may not exist yet cannot be made or written"""
    present = next(one for one in (folder, *folder.parents) if one.exists())
    if not present.is_dir() or not os.access(present, os.W_OK):
        raise DataError(f'{folder}: cannot write takes: {present} is no folder that can be '
                        'written')


def main(arguments: list[str] | None = None) -> int:
    """Run the node ``take_recorder``."""
    return run([TakeRecorder], arguments)


if __name__ == '__main__':
    raise SystemExit(main())

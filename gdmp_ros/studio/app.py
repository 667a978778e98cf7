"""The studio itself: one thread that does what the page asks for, and shows what has changed."""
from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
import threading
import traceback
from typing import Any, TypeVar
import warnings

import numpy as np
import viser

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import GdmpError, GdmpWarning
from gdmp_ros.learning.detour import BlockedError, detour, leads_around
from gdmp_ros.playback.streamed_skill import is_of_joints
from gdmp_ros.realtime.loop import Clock, Loop, NS, run, SystemClock
from gdmp_ros.scene import Scene as Surroundings
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.gripper import arm_with_gripper
from gdmp_ros.sim.path_check import PathChecker, Reach
from gdmp_ros.studio.commands import Jobs
from gdmp_ros.studio.motion import of_demonstration, of_skill, ShownMotion, tube
from gdmp_ros.studio.robot import Robot, RobotView
from gdmp_ros.studio.scene import colour, LAYERS, Scene
from gdmp_ros.studio.workbench import Workbench

#: Interval at which the robot is shown, and at which the studio looks for work [s].
REFRESH_S, LOOK_S = 0.05, 0.005
#: What takes longer than a drag is computed when nothing has changed for this time, and while
#: something is dragged for the second one [s].
QUIET_S, DRAGGED_S = 0.2, 1.0
#: Samples of a motion that are checked for reach.
CHECKED = 50
#: Past path of the tool [s].
PAST_S = 10.0
T = TypeVar('T')


@dataclass(frozen=True)
class Verdict:
    """
    Whether the arm can follow a motion.

    :ivar wrong: samples at which it cannot, shape ``(T,)`` of the motion
    :ivar text: for people
    """

    wrong: np.ndarray
    text: str


NOT_CHECKED = Verdict(np.empty(0, dtype=bool), '')


class Studio:
    """
    What the panels share.

    One loop does the work; callbacks of the page only put it into `jobs`. A second one computes
    what takes longer than a drag.

    :ivar clock: of the studio
    :ivar skill: the chosen skill with its changes; None without one
    :ivar motion: that is shown: of the changed skill, or a recorded one; None without one
    :ivar guided: whether the user guides the arm: the handles of the skill are hidden then
    :ivar takes_folder: where takes are recorded
    :ivar on_motion: called when the shown motion has changed
    :ivar on_goal: called with the goal pose that the user has moved
    :ivar on_object: called with name and pose of an object that the user has moved
    :ivar on_view: called with the newest view of the robot
    :ivar on_opened: called when something was opened
    :ivar on_quiet: called when what takes longer has been computed
    """

    def __init__(self, server: viser.ViserServer, bench: Workbench, robot: Robot, model: str,
                 takes_folder: Path, clock: Clock | None = None):
        """
        Draw the arm.

        :param model: of the arm, as for ``panda_sim``
        :param clock: by default that of the system
        :raises DataError: if a skill is not one of this arm
        """
        self.clock = clock or SystemClock()
        self.server, self.bench, self.robot = server, bench, robot
        self.takes_folder, self.jobs, self._slow = takes_folder, Jobs(), Jobs()
        self._arm = Arm(model)
        bench.serve(self._arm.names)
        self._reach = Reach(Arm(model))
        self._checker = PathChecker(Arm(model))
        self.scene = Scene(server, arm_with_gripper(model)[0], Arm(model))
        self.motion: ShownMotion | None = None
        self.skill: Skill | None = None
        self.verdict = NOT_CHECKED
        self.view: RobotView | None = None
        self.compared: set[str] = set()
        self.guided = False
        self.on_motion: list[Callable[[], None]] = []
        self.on_goal: list[Callable[[np.ndarray], None]] = []
        self.on_object: list[Callable[[str, np.ndarray], None]] = []
        self.on_view: list[Callable[[RobotView | None], None]] = []
        self.on_quiet: list[Callable[[], None]] = []
        self.on_opened: list[Callable[[], None]] = []
        self._quiet_at, self._ended, self._dragging = 0.0, False, False
        self._past: list[tuple[float, np.ndarray]] = []
        # The skill that was looked at, and whether there was anything.
        self._looked_at, self._looked = '', False

    # Work

    def run(self, ends: threading.Event) -> None:
        """Do what the page asks for until the event is set; warnings are shown on the page."""
        with warnings.catch_warnings():
            warnings.simplefilter('always', GdmpWarning)
            warnings.showwarning = self._show_warning  # type: ignore[assignment]
            run(self.steps(), self.clock, ends.is_set)

    def steps(self) -> Loop:
        """Do what the page asks for, and show the robot."""
        self.clock.start(self._steps_of_slow())
        try:
            self.redraw()
            due = self.now()
            while True:
                work = self.jobs.take()
                if work is not None:
                    self._attempt(work)
                if self.now() >= due:
                    due = self.now() + REFRESH_S
                    self._attempt(self._refresh)
                if self._quiet_at and self.now() >= self._quiet_at and work is None:
                    self._quiet_at = 0.0
                    self._slow.put(partial(self._compute, self.skill, self.motion), 'newest')
                yield self.clock.now() + (0 if work is not None else round(LOOK_S * NS))
        finally:
            self._ended = True

    def now(self) -> float:
        """Steady time [s]."""
        return self.clock.now() / NS

    def later(self, work: Callable[[], None], kind: str | None = None) -> Callable[[Any], None]:
        """Callback of the page that leaves work to the studio's thread (`Jobs.put`)."""
        async def callback(event: Any) -> None:
            # What the studio itself writes to a field is no wish of a user.
            if event.client_id is not None:
                self.jobs.put(work, kind)
        return callback  # type: ignore[return-value]

    def entered(self, work: Callable[[Any], None], kind: str | None = None
                ) -> Callable[[Any], None]:
        """
        Callback of a field: work with the value that the user has entered.

        The studio may write to the field before the work is done.
        """
        async def callback(event: Any) -> None:
            if event.client_id is not None:
                self.jobs.put(partial(work, event.target.value), kind)
        return callback  # type: ignore[return-value]

    def background(self, title: str, work: Callable[[], T], done: Callable[[T], None]) -> None:
        """
        Work that takes long: in a thread of its own, with a notice while it lasts.

        :param done: called with the result by the studio's thread
        """
        notice = [client.add_notification(title, '', loading=True, with_close_button=False)
                  for client in self.server.get_clients().values()]

        def carry_out() -> None:
            try:
                result = work()
                self.jobs.put(lambda: done(result))
            except GdmpError as error:
                text = str(error)
                self.jobs.put(lambda: self.notify('refused', text, 'red'))
            except Exception:
                text = traceback.format_exc()
                print(text, flush=True)
                self.jobs.put(lambda: self.notify('failed', text, 'red'))
            finally:
                for item in notice:
                    with suppress(Exception):  # the browser may be gone
                        item.remove()

        self.clock.start(_once(carry_out))

    def notify(self, title: str, text: str, paint: Any = 'blue') -> None:
        """Tell all browsers something."""
        for client in self.server.get_clients().values():
            client.add_notification(title, text, color=paint,
                                    auto_close_seconds=20.0 if paint == 'red' else 6.0)

    def _show_warning(self, message: Warning | str, category: type[Warning], *rest: Any) -> None:
        if issubclass(category, GdmpWarning):
            self.notify('note', str(message), 'yellow')

    def _attempt(self, work: Callable[[], None]) -> None:
        """Work whose refusal is shown, and does not end the studio."""
        try:
            work()
        except (GdmpError, OSError) as error:
            self.notify('refused', str(error), 'red')

    def goal_moved(self) -> None:
        """Tell that the user has moved the goal."""
        if self.skill is not None:
            for tell in self.on_goal:
                tell(self.pose_of(self.skill, self.skill.goal))

    # Skills of the tool and of the joints

    def motion_of(self, skill: Skill) -> ShownMotion:
        """The motion of a skill between its own ends; by the studio's thread."""
        return of_skill(skill, self._arm.pose_at)

    def pose_of(self, skill: Skill, point: np.ndarray) -> np.ndarray:
        """Pose of the tool at a point of a skill."""
        if is_of_joints(skill):
            return self._arm.pose_at(point)
        return np.array(point[:7])

    def place_at(self, skill: Skill, pose: np.ndarray, near: np.ndarray) -> np.ndarray:
        """
        A pose as a place of a skill: itself, or the posture that comes nearest to it [rad].

        :param near: point of the skill, where the posture is searched
        """
        if is_of_joints(skill):
            return self._reach.towards(pose, near)[0]
        return pose

    # The shown motion

    def change(self, work: Callable[[], None], dragged: bool = False) -> None:
        """
        Change the skill and show it; a change that is impossible is taken back.

        :param dragged: whether the next change is likely to follow at once
        :raises GdmpError: if it is impossible
        """
        bench, before = self.bench, self.bench.changes.copy()
        try:
            work()
            self.redraw()
        except GdmpError:
            bench.changes = before
            self.redraw()
            raise
        # What is dragged is one change.
        if not self._dragging:
            bench.remember(before)
        self._dragging = dragged
        if dragged:
            self._quiet_at = self.now() + DRAGGED_S

    def redraw(self) -> None:
        """Show the changed skill, or the recorded motion without one."""
        bench = self.bench
        last_run = next(reversed(bench.runs.values()), (None, None))
        self.skill = bench.edited() if bench.chosen else None
        self.motion = last_run[1] if self.skill is None else self.motion_of(self.skill)
        if bench.chosen != self._looked_at or not self._looked:
            self._looked_at, self._looked = bench.chosen, self.motion is not None
            self.look()
        self.scene.line('sent', None if last_run[0] is None else last_run[0].poses[:, :3],
                        colour(5))
        self.verdict = NOT_CHECKED
        motion = self.motion
        self.scene.notes(() if motion is None else motion.gripper_notes())
        self.scene.line('path', None if motion is None else motion.poses[:, :3], colour(1))
        self.scene.tube(None)
        self.scene.line('around', None, colour(3))
        self._quiet_at = self.now() + QUIET_S
        for tell in self.on_motion:
            tell()

    def surround(self, scene: Surroundings) -> None:
        """
        Use other surroundings: of the arm, and on the page.

        :raises GdmpError: if the robot refuses them
        """
        self.robot.surround(scene)
        self.bench.scene = scene
        for name in self.scene.volumes():
            if name not in scene:
                self.scene.volume(name, None)
        for volume in scene.around:
            self.scene.volume(volume.name, volume)
        self.redraw()

    def look(self) -> None:
        """Look at the motion from the side that shows it."""
        self.scene.look(None if self.motion is None else self.motion.poses[:, :3])

    def _steps_of_slow(self) -> Loop:
        while not self._ended:
            work = self._slow.take()
            if work is not None:
                self._attempt(work)
            yield self.clock.now() + round(REFRESH_S * NS)

    def _compute(self, skill: Skill | None, motion: ShownMotion | None) -> None:
        """Compute what takes longer than a drag; by a thread of its own."""
        likely = None if skill is None else tube(skill)
        verdict = NOT_CHECKED if motion is None else self._checked(motion)
        around = ''
        led: np.ndarray | None = None
        if skill is not None and len(self.bench.scene) and leads_around(skill):
            try:
                found = detour(skill, self.bench.scene, self._checker.tool)
                if found.around:
                    led = of_skill(found.skill).poses[:, :3]
                    around = (f'led around {", ".join(found.around)}: {found.longer:.2f} times as '
                              'long')
            except BlockedError as error:
                around = f'**{error}**'
        if around:
            verdict = Verdict(verdict.wrong, f'{verdict.text}; {around}')
        self.jobs.put(lambda: self._complete(motion, likely, verdict, led), 'complete')

    def _complete(self, motion: ShownMotion | None, likely: tuple[np.ndarray, np.ndarray] | None,
                  verdict: Verdict, led: np.ndarray | None) -> None:
        """Show what took longer than a drag, unless the motion has changed since."""
        bench, scene = self.bench, self.scene
        if motion is not self.motion:
            return
        scene.stiffness(motion)
        scene.tube(likely)
        self.verdict = verdict
        scene.line('around', led, LAYERS['around'][0] or colour(3))
        if motion is not None:
            scene.line('path', motion.poses[:, :3], colour(1), verdict.wrong)
        names = {f'take {take.path}'.replace('/', ':'): take for take in bench.takes if take.used}
        for name in scene.lines('take '):
            if name not in names:
                scene.line(name, None, colour(4))
        for name, take in names.items():
            if name not in scene.lines('take '):
                demo = of_demonstration(take.recording.demonstration, self._arm.pose_at)
                scene.line(name, demo.poses[:, :3], (150, 150, 150))
        for number, name in enumerate(bench.skills):
            shown_skill = name in self.compared and name != bench.chosen
            scene.line(f'skill {name}', self.motion_of(bench.skills[name]).poses[:, :3]
                       if shown_skill else None, colour(number + 2))
        for tell in self.on_quiet:
            tell()

    def _checked(self, motion: ShownMotion) -> Verdict:
        """Whether the arm can follow the motion; one that was recorded has been followed."""
        if motion.recorded:
            return Verdict(np.zeros(len(motion.times), dtype=bool), '')
        thin = motion.thinned(CHECKED)
        result = (self._checker.check(thin.times, thin.poses) if thin.joints is None else
                  self._checker.check_postures(thin.times, thin.joints))
        wrong = np.interp(motion.times, thin.times, result.wrong) > 0.0
        return Verdict(wrong, '; '.join(result.problems()) or 'the arm can follow the whole path')

    def posture_at(self, time_s: float) -> np.ndarray | None:
        """Posture of the arm in the shown motion [rad]; None without a motion."""
        motion = self.motion
        if motion is None:
            return None
        at = motion.index(time_s)
        if motion.joints is not None:
            return np.asarray(motion.joints[at])
        near = self._arm.home if self.view is None else self.view.joints
        return self._reach.towards(motion.poses[at], near)[0]

    # The robot

    def _refresh(self) -> None:
        self.view = view = self.robot.view()
        if view is None:
            self.scene.arm.show(None)
        else:
            self.scene.arm.show(view.joints, view.width)
        if view is not None:
            now = self.now()
            self._past.append((now, view.pose[:3]))
            self._past = [item for item in self._past if item[0] > now - PAST_S]
            still = np.ptp([item[1] for item in self._past], axis=0).max() < 1e-3
            self.scene.line('past', None if still else np.array([item[1] for item in self._past]),
                            colour(0))
        for tell in self.on_view:
            tell(view)


def _once(work: Callable[[], None]) -> Loop:
    """A loop that does something once."""
    yield 0
    work()

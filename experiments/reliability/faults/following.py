"""An arm that does not follow, or that must not begin to."""
from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

import numpy as np

from experiments.reliability.trial import FaultTrial, FRAME
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.control.modes import ArmMode, StreamMode
from gdmp_ros.control.target import resting_target
from gdmp_ros.data.runs import Run
from gdmp_ros.ros import messages
from gdmp_ros.ros.clients.testbed import ARM, SERVER

#: Largest step of the reference from tick to tick [m].
STEP_M = 0.5e-3


def stands_still(trial: FaultTrial, quick: bool) -> TrialResult:
    """The robot does not move while a motion is streamed"""
    outcome = TrialResult()
    trial.start()
    _teach(trial, True)
    trial.execute()
    result = trial.client.result(60.0)
    outcome.measured['the motion ended with'] = result.error_string
    outcome.claim('the motion is blocked', result.error_code == result.BLOCKED)
    _teach(trial, False)
    trial.spend(1.0)
    _judge_still(trial.finish(outcome, None, follows=False), outcome)
    return outcome


def teaching_ends(trial: FaultTrial, quick: bool) -> TrialResult:
    """Hand guiding ends while a motion is streamed"""
    outcome = TrialResult()
    trial.start()
    _teach(trial, True)
    trial.execute()
    trial.wait('the motion', lambda: trial.state.progress > 0.05)
    _teach(trial, False)
    trial.spend(2.0)
    trial.client.cancel()
    _judge_still(trial.finish(outcome, None, follows=False), outcome)
    return outcome


def out_of_reach(trial: FaultTrial, quick: bool) -> TrialResult:
    """A goal that the arm cannot reach"""
    from gdmp_msgs.action import ExecuteSkill
    outcome = TrialResult()
    trial.start()
    for position in ((0.75, 0.55, 0.9), (0.05, 0.0, 0.05)):
        goal = ExecuteSkill.Goal(use_goal_pose=True)
        goal.goal_pose.header.frame_id = FRAME
        messages.set_pose(goal.goal_pose.pose, np.array([*position, 0.0, 1.0, 0.0, 0.0]))
        trial.execute(goal)
        result = trial.client.result(10.0)
        outcome.claim(f'({position[0]}, {position[1]}, {position[2]}) m is refused',
                      result.error_code == result.INVALID_GOAL
                      and 'cannot be reached' in result.error_string)
    _judge_still(trial.finish(outcome, None, follows=False), outcome)
    return outcome


def moved_while_inactive(trial: FaultTrial, quick: bool) -> TrialResult:
    """The arm is moved by hand while the server is inactive"""
    from geometry_msgs.msg import PoseStamped
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState
    outcome = TrialResult()
    poses: list[PoseStamped] = []
    trial.start()

    def change(number: int) -> None:
        request = ChangeState.Request()
        request.transition.id = number
        trial.call(ChangeState, f'{SERVER}/change_state', transition=request.transition)
    trial.client.subscribe(PoseStamped, f'{ARM}/measured_pose', poses.append, 1)
    hand = trial.client.publisher(PoseStamped, f'{ARM}/hand_pose', 1)
    change(Transition.TRANSITION_DEACTIVATE)
    _teach(trial, True)
    trial.wait('the arm', lambda: bool(poses))
    goal = messages.pose_numbers(poses[-1].pose) + [0.1, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0]
    message = PoseStamped()
    message.header.frame_id = FRAME
    messages.set_pose(message.pose, goal)

    def arrived() -> bool:
        hand.publish(message)
        return bool(np.linalg.norm(messages.pose_numbers(poses[-1].pose)[:3] - goal[:3]) < 0.01)
    trial.wait('the arm to follow the hand', arrived)
    # The hand is at rest before it lets go, and the arm afterwards.
    trial.spend(1.0)
    _teach(trial, False)
    trial.spend(2.0)
    activated = time.time_ns()
    change(Transition.TRANSITION_ACTIVATE)
    trial.client.wait_status('holding', 10.0)
    trial.spend(1.0)
    executed = time.time_ns()
    trial.execute()
    trial.reaches_goal(outcome, 'the next motion reaches its goal')
    run = trial.finish(outcome)
    held = (run.state_stamps > activated) & (run.state_stamps < executed)
    outcome.need('the arm moved after the activation by [m]', _moved(run, held),
                 lambda v: v < 1e-3)
    return outcome


def reference_jumps(trial: FaultTrial, quick: bool) -> TrialResult:
    """References jump by 0.5 m and go on there"""
    from gdmp_msgs.msg import Reference, RobotState
    outcome = TrialResult()
    states: list[RobotState] = []
    trial.start_arm()
    trial.client.subscribe(RobotState, f'{ARM}/state', states.append, 1)
    out = trial.client.publisher(Reference, f'/{SERVER}/reference')
    trial.wait('the arm', lambda: bool(states) and out.subscribers() > 0, 60.0)
    start, message = messages.pose_numbers(states[-1].pose), Reference()
    message.header.frame_id = FRAME

    def stream(pose: np.ndarray, seconds: float, until: Callable[[], bool]) -> None:
        messages.fill_reference(message, resting_target(pose))
        ends = time.monotonic() + seconds
        while time.monotonic() < ends and not until():
            message.sequence += 1
            message.header.stamp = messages.stamp_of(time.time_ns())
            out.publish(message)
            trial.spend(0.005)
    stream(start, 5.0, lambda: states[-1].mode == ArmMode.FOLLOW)
    outcome.claim('the arm follows before', states[-1].mode == ArmMode.FOLLOW)
    stream(start + [0.1, 0.49, 0.0, 0.0, 0.0, 0.0, 0.0], 3.0, lambda: False)
    outcome.claim('the arm says why it does not follow', 'call ~/arm' in trial.log(ARM))
    shown = np.array([messages.pose_numbers(state.pose)[:3] for state in states])
    outcome.need('the arm moved by [m]',
                 float(np.linalg.norm(shown - start[:3], axis=1).max()), lambda v: v < 1e-3)
    outcome.claim('the arm holds at the end', states[-1].mode == ArmMode.HOLD)
    return outcome


def _teach(trial: FaultTrial, guided: bool) -> None:
    from std_srvs.srv import SetBool
    trial.call(SetBool, f'{ARM}/teach', data=guided)


def _moved(run: Run, chosen: Any) -> float:
    """Largest distance from the first of the chosen states [m]."""
    poses = run.poses[chosen, :3]
    return float(np.linalg.norm(poses - poses[0], axis=1).max())


def _judge_still(run: Run, outcome: TrialResult) -> None:
    """Require that nothing moved that was not asked to."""
    outcome.need('the arm moved by [m]', _moved(run, np.ones(len(run.poses), bool)),
                 lambda v: v < 1e-3)
    outcome.claim('nothing was followed', not (run.arm_modes == ArmMode.FOLLOW).any())
    one = (run.modes[1:] != StreamMode.ENDED) & (np.diff(run.sequences.astype(np.int64)) == 1)
    ticks = np.maximum(np.round(np.diff(run.reference_stamps) / 1e6), 1.0)
    steps = np.linalg.norm(np.diff(run.references[:, :3], axis=0), axis=1) / ticks
    outcome.need('largest step of the reference in a tick [m]', float(steps[one].max()),
                 lambda v: v < STEP_M)

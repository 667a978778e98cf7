"""A unit quaternion trajectory, and a goal switch during the motion."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments.paper.experiment import Data, Settings, Verdict
from gdmp_ros.dmp import Demonstration, Rollout, Skill
from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.util.profiles import minimum_jerk
from gdmp_ros.view import plots

CLAIM = ('A unit quaternion trajectory is reproduced; after a goal switch during the motion the '
         'error to the new goal vanishes.')
SOURCE = '[GDMP] Fig. 4, section 5.2'
S3 = UnitQuaternion()
#: As printed, scalar first; normalised, because their norm is 1.00003.
START = S3.project(np.array([-0.0092, -0.7126, 0.7015, 0.0090]))
GOAL = S3.project(np.array([0.8104, 0.3364, 0.2141, 0.4293]))
NEW_GOAL = S3.project(np.array([0.7442, 0.5414, -0.0343, 0.3897]))
DURATION, DT = 10.0, 0.01
#: Largest distance of the motion from the geodesic, half-angle [rad].
LATERAL_RAD = 0.3
#: Time of the goal switch and of the end, in durations.
SWITCH, END = 0.5, 1.6


def shown() -> Demonstration:
    """
    Minimum jerk from start to goal plus a lateral curve.

    The paper prints no trajectory: along the geodesic by u = 10 t³ - 15 t⁴ + 6 t⁵, and across it
    by 0.3 sin²(π u) in the direction ``Log × z``, at rest at both ends.
    """
    t = np.linspace(0.0, 1.0, round(DURATION / DT) + 1)
    along = minimum_jerk(t)
    way = S3.log(START, GOAL)
    across = np.cross(way, [0.0, 0.0, 1.0])
    across *= LATERAL_RAD / np.linalg.norm(across)
    points = [S3.exp(START, u * way + np.sin(np.pi * u) ** 2 * across) for u in along]
    return Demonstration(DURATION * t, np.array(points), S3)


def run(settings: Settings) -> Data:
    """Roll out to the goal and, switched, to the new one."""
    demonstration = shown()
    skill = Skill.learn(demonstration, 60, 60.0, 4.6052, fit='forcing', end='moving')
    times = np.arange(0.0, END * DURATION + 1e-9, DT)
    straight = Rollout(skill).sample(times).points
    rollout = Rollout(skill)
    half = round(SWITCH * DURATION / DT)
    before = rollout.sample(times[:half]).points
    rollout.retarget(NEW_GOAL)
    switched = np.vstack([before, rollout.sample(times[half:]).points])
    return {'times': times, 'shown': demonstration.points, 'straight': straight,
            'switched': switched, 'goal': GOAL, 'new_goal': NEW_GOAL}


def rotation_vectors(points: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """``2 Log_Q(Q_g)`` of each point [rad], shape ``(T, 3)``."""
    return np.array([2.0 * S3.log(q, goal) for q in points])


def verdict(data: Data) -> Verdict:
    """Errors at the end, and along the demonstration."""
    to_goal = np.linalg.norm(rotation_vectors(data['straight'][-1:], data['goal'])[0])
    to_new = np.linalg.norm(rotation_vectors(data['switched'][-1:], data['new_goal'])[0])
    along = [2.0 * S3.distance(a, b) for a, b in zip(data['shown'], data['straight'])]
    measured = {'error_to_goal_rad': to_goal, 'error_to_new_goal_rad': to_new,
                'mean_error_rad': np.mean(along), 'largest_error_rad': np.max(along),
                'goal_moved_rad': 2.0 * S3.distance(data['goal'], data['new_goal'])}
    holds = to_goal < 0.0025 and to_new < 0.0025 and bool(np.mean(along) < 1e-3)
    return Verdict(bool(holds), measured)


def draw(data: Data) -> dict[str, Any]:
    """Errors per axis to both goals, and the quaternion's elements."""
    figure, axes = plots.panels(2, 2, (5.4, 3.2))
    times = data['times']
    columns = ((data['straight'], data['goal'], 'goal'),
               (data['switched'], data['new_goal'], 'new goal'))
    for (points, goal, name), (error, element) in zip(columns, axes.T):
        plots.series(error, times, rotation_vectors(points, goal), ['x', 'y', 'z'],
                     f'error 2 Log to the {name} [rad]')
        plots.series(element, times, points, ['w', 'x', 'y', 'z'],
                     f'quaternion to the {name} [1]')
        element.plot(DT * np.arange(len(data['shown'])), data['shown'], ls=(0, (4, 4)), lw=0.8,
                     color='black')
        element.plot([], [], ls=(0, (4, 4)), lw=0.8, color='black', label='demonstration')
        if name == 'new goal':
            for panel in (error, element):
                panel.axvline(SWITCH * DURATION, color='0.4', lw=0.8, label='goal switched')
        error.legend(ncols=2)
        element.legend(ncols=3, fontsize=7)
    return {'fig4': figure}

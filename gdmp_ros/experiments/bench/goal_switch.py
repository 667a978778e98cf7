"""How calm a goal switch is: 0.37 m and 0.8 rad at mid-run of a 1 s motion, beside the peer's."""
from __future__ import annotations

from typing import Any

import numpy as np

from gdmp_ros.dmp import Demonstration, Rollout, Skill
from gdmp_ros.experiments import timing as measure
from gdmp_ros.experiments.bench.peers import CartesianPeer
from gdmp_ros.manifolds import UnitQuaternion

TITLE = 'goal switched by 0.37 m and 0.8 rad at mid-run of a 1 s motion'
DT, DURATION = 1e-3, 1.0
MOVE_M = 0.37 * np.array([2.0, -1.0, 2.0]) / 3.0
TURN_RAD = 0.8 * np.array([1.0, 2.0, -2.0]) / 3.0


def run(settings: measure.Settings) -> dict[str, Any]:
    """
    Accelerations of both after the switch, linear [m/s²] and angular [rad/s²].

    ``step``: largest change within a tick around the switch; ``allowed``: what a tick of the goal
    filter explains, beside the change without a switch.
    """
    shown = measure.demonstration(measure.POSE, DURATION)
    goal = shown.points[-1].copy()
    goal[:3] += MOVE_M
    goal[3:] = UnitQuaternion().exp(goal[3:], 0.5 * TURN_RAD)
    ours, calm, skill = _ours(shown, goal)
    theirs = _peer(shown, goal)
    filter_tick = (skill.gains.alpha_z * skill.gains.beta_z / DURATION ** 2
                   * -np.expm1(-skill.gains.alpha_g * DT / DURATION))
    at = round(0.5 * DURATION / DT)
    document: dict[str, Any] = {'times': (DT * np.arange(len(ours))).tolist()}
    for name, part, size in (('linear', slice(0, 3), 0.37), ('angular', slice(3, 6), 0.8)):
        without = _steps(calm[:, part])[at - 2:at + 10].max()
        document[name] = {
            'step': float(_steps(ours[:, part])[at - 2:at + 10].max()),
            'allowed': float(without + filter_tick * size),
            'peak': float(np.linalg.norm(ours[at - 2:, part], axis=1).max()),
            'peer_step': float(_steps(theirs[:, part])[at - 2:at + 10].max()),
            'peer_peak': float(np.linalg.norm(theirs[at - 2:, part], axis=1).max()),
            'curve': np.linalg.norm(ours[:, part], axis=1).tolist(),
            'peer_curve': np.linalg.norm(theirs[:, part], axis=1).tolist()}
    return document


def _steps(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(np.diff(values, axis=0), axis=1))


def _ours(shown: Demonstration, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray, Skill]:
    """Accelerations with the switch and without, in rotation vectors, and the skill."""
    skill = Skill.learn(shown, 50)
    result = []
    for switch in (True, False):
        rollout, rows = Rollout(skill), []
        for tick in range(round(1.6 * DURATION / DT)):
            if switch and tick == round(0.5 * DURATION / DT):
                rollout.retarget(goal)
            rows.append(rollout.advance(DT).acceleration * [1, 1, 1, 2, 2, 2])
        result.append(np.array(rows))
    return result[0], result[1], skill


def _peer(shown: Demonstration, goal: np.ndarray) -> np.ndarray:
    peer = CartesianPeer(shown, 50, DT)
    peer.learn()
    peer.begin()
    velocities = [peer.velocity.copy()]
    for tick in range(round(1.6 * DURATION / DT)):
        if tick == round(0.5 * DURATION / DT):
            peer.dmp.configure(goal_y=goal)
        peer.step()
        velocities.append(peer.velocity.copy())
    return np.asarray(np.diff(velocities, axis=0) / DT)


def rows(document: dict[str, Any]) -> list[list[str]]:
    """Table: heads, then lines."""
    lines = []
    for name, unit in (('linear', 'm/s²'), ('angular', 'rad/s²')):
        d = document[name]
        lines += [[f'{name} acceleration, largest step in a tick [{unit}]', f'{d["step"]:.2f}',
                   f'{d["allowed"]:.2f}', f'{d["peer_step"]:.1f}'],
                  [f'{name} acceleration, peak [{unit}]', f'{d["peak"]:.1f}', '',
                   f'{d["peer_peak"]:.1f}']]
    return [['', 'gdmp_ros', 'explained by the goal filter', 'movement_primitives'], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Angular acceleration over time."""
    d = document['angular']
    axes.plot(document['times'], d['curve'], '-', color='black', label='gdmp_ros')
    axes.plot(document['times'], d['peer_curve'][:len(document['times'])], ':', color='black',
              label='movement_primitives')
    axes.axvline(0.5 * DURATION, color='0.6', lw=0.8)
    axes.set(xlabel='time [s]', ylabel='angular acceleration [rad/s²]', yscale='log',
             ylim=(0.5, None), title='goal switched by 0.37 m and 0.8 rad')
    axes.legend()

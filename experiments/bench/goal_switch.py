"""Accelerations of a goal switch by 0.37 m and 0.8 rad, compared with movement_primitives."""
from __future__ import annotations

from typing import Any

import numpy as np

from experiments import timing
from experiments.bench.peers import CartesianPeer
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.quaternion import UnitQuaternion

TITLE = 'goal switched by 0.37 m and 0.8 rad at mid-run of a 1 s motion'
DT, DURATION = 1e-3, 1.0
DISTANCE_M, ANGLE_RAD = 0.37, 0.8
MOVE_M = DISTANCE_M * np.array([2.0, -1.0, 2.0]) / 3.0
ROTATION_RAD = ANGLE_RAD * np.array([1.0, 2.0, -2.0]) / 3.0
#: Ways to use the peer: with its defaults, and with its option for smaller accelerations.
PEERS = {'peer': False, 'peer_smooth': True}
PEER_NAMES = {'peer': 'movement_primitives, defaults',
              'peer_smooth': 'movement_primitives, smooth_scaling=True'}


def run(settings: timing.TimingSettings) -> dict[str, Any]:
    """
    Accelerations after the switch, linear [m/s²] and angular [rad/s²].

    ``step``: largest change within a tick around the switch; ``allowed``: the change without a
    switch plus that of one tick of the goal filter.
    """
    shown = timing.demonstration(timing.POSE, DURATION)
    goal = shown.points[-1].copy()
    goal[:3] += MOVE_M
    goal[3:] = UnitQuaternion().exp(goal[3:], 0.5 * ROTATION_RAD)
    skill = Skill.learn(shown, 50)
    curves = {'': _ours(skill, goal), **{name: _peer(shown, goal, smooth)
                                         for name, smooth in PEERS.items()}}
    unswitched = _ours(skill, None)
    filter_tick = (skill.gains.alpha_z * skill.gains.beta_z / DURATION ** 2
                   * -np.expm1(-skill.gains.alpha_g * DT / DURATION))
    at = round(0.5 * DURATION / DT)
    around, after = slice(at - 2, at + 10), slice(at - 2, None)
    document: dict[str, Any] = {'times': (DT * np.arange(len(unswitched))).tolist()}
    for name, part, size in (('linear', slice(0, 3), DISTANCE_M),
                             ('angular', slice(3, 6), ANGLE_RAD)):
        figures = {'allowed': float(_steps(unswitched[:, part])[around].max()
                                    + filter_tick * size)}
        for who, curve in curves.items():
            prefix, values = f'{who}_' if who else '', curve[:, part]
            norms = np.linalg.norm(values, axis=1)
            figures |= {f'{prefix}step': float(_steps(values)[around].max()),
                        f'{prefix}peak': float(norms[after].max()),
                        f'{prefix}curve': norms.tolist()}
        document[name] = figures
    return document


def _steps(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(np.diff(values, axis=0), axis=1))


def _ours(skill: Skill, goal: np.ndarray | None) -> np.ndarray:
    """Accelerations with a switch to ``goal``, or without one; rotation vectors."""
    rollout, accelerations = Rollout(skill), []
    for tick in range(round(1.6 * DURATION / DT)):
        if goal is not None and tick == round(0.5 * DURATION / DT):
            rollout.retarget(goal)
        accelerations.append(rollout.advance(DT).acceleration * [1, 1, 1, 2, 2, 2])
    return np.array(accelerations)


def _peer(shown: Demonstration, goal: np.ndarray, smooth_scaling: bool) -> np.ndarray:
    peer = CartesianPeer(shown, 50, DT, smooth_scaling=smooth_scaling)
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
    """Table: heading, then lines."""
    lines = []
    for name, unit in (('linear', 'm/s²'), ('angular', 'rad/s²')):
        d = document[name]
        lines += [[f'{name} acceleration, largest step in a tick [{unit}]', f'{d["step"]:.2f}',
                   f'{d["allowed"]:.2f}', *(f'{d[f"{who}_step"]:.1f}' for who in PEERS)],
                  [f'{name} acceleration, peak [{unit}]', f'{d["peak"]:.1f}', '',
                   *(f'{d[f"{who}_peak"]:.1f}' for who in PEERS)]]
    return [['', 'gdmp_ros', 'due to the goal filter', *PEER_NAMES.values()], *lines]


def draw(document: dict[str, Any], axes: Any) -> None:
    """Angular acceleration over time."""
    d = document['angular']
    for key, style, name in (('curve', '-', 'gdmp_ros'),
                             ('peer_curve', ':', PEER_NAMES['peer']),
                             ('peer_smooth_curve', '--', PEER_NAMES['peer_smooth'])):
        axes.plot(document['times'], d[key], style, color='black', label=name)
    axes.axvline(0.5 * DURATION, color='0.6', lw=0.8)
    axes.set(xlabel='time [s]', ylabel='angular acceleration [rad/s²]', yscale='log',
             ylim=(0.5, None), title='goal switched by 0.37 m and 0.8 rad')
    axes.legend(fontsize=7)

"""A Panda refills a watering can: pose and stiffness from five kinesthetic demonstrations."""
from __future__ import annotations

from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.signal import savgol_filter

from experiments.paper.experiment import Data, Settings, spd_distances, Verdict
from gdmp_ros.data.lasa import TOOL
from gdmp_ros.dmp import Demonstration, Skill
from gdmp_ros.learning.stiffness import force_stiffness, ForceRecords
from gdmp_ros.manifolds import UnitQuaternion
from gdmp_ros.util.profiles import minimum_jerk
from gdmp_ros.view import plots

CLAIM = ('On R³ × S³ × SPD(3), pose and stiffness learned from five demonstrations with forces '
         'let a Panda dip a watering can into a tray and lift it out.')
SOURCE = '[GDMP] Fig. 11, section 5.6.1, eqs. (39), (40); [16] Abu-Dakka, Rozo, Caldwell 2018'
S3 = UnitQuaternion()
TAKES, SAMPLES = 5, 600
#: Path of the centre of the can [m] and its tilt [rad] over progress.
AT = (0.0, 0.2, 0.38, 0.5, 0.6, 0.78, 1.0)
MIDDLE = np.array([[0.42, -0.10, 0.42], [0.47, -0.03, 0.36], [0.49, 0.0, 0.24], [0.50, 0.0, 0.13],
                   [0.50, 0.0, 0.13], [0.49, 0.03, 0.29], [0.44, 0.12, 0.42]])
TILT = np.array([0.0, 0.1, 0.7, 1.0, 0.95, 0.2, 0.0])
_COURSE = PchipInterpolator(AT, np.column_stack([MIDDLE, TILT]))
#: The hand: soft on the way, firm at the water; rotational stiffness of the robot [Nm/rad].
SOFT, FIRM = np.array([300.0, 300.0, 300.0]), np.array([350.0, 650.0, 550.0])
HAND_DAMPING, ROTATIONAL = 40.0, 150.0
#: Rest of the robot after the motion [s].
REST_S = 0.5


def intention(progress: float) -> np.ndarray:
    """Pose of the can that the hand intends; upright is the identity."""
    *middle, tilt = _COURSE(_eased(progress))
    return np.concatenate([middle, S3.exp(np.array([1.0, 0.0, 0.0, 0.0]),
                                          np.array([0.0, 0.5 * tilt, 0.0]))])


def _eased(progress: float) -> float:
    """Slow at both ends."""
    return float(0.5 * progress + 0.5 * minimum_jerk(progress))


def holding(progress: float) -> np.ndarray:
    """Stiffness of the hand at a progress, rotated slightly about z [N/m]."""
    near = np.exp(-((_eased(progress) - 0.52) / 0.17) ** 2)
    turn = np.array([[np.cos(0.4), -np.sin(0.4), 0.0], [np.sin(0.4), np.cos(0.4), 0.0],
                     [0.0, 0.0, 1.0]])
    return np.asarray(turn @ np.diag(SOFT + near * (FIRM - SOFT)) @ turn.T)


def teach() -> Data:
    """Five demonstrations, on the same normalised time."""
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.scenes import watering
    from gdmp_ros.sim.teaching import demonstrate, GuidingHand, Timing
    arm, hand = Arm(watering()), GuidingHand(intention, holding, HAND_DAMPING)
    rng, beginning = np.random.default_rng(11), _beginning(arm)
    columns: dict[str, list[np.ndarray]] = {}
    for _ in range(TAKES):
        timing = Timing(rng.uniform(9.0, 11.0), rng.uniform(-0.06, 0.06), 3.0)
        arm.reset(beginning)
        taught = demonstrate(arm, 'can', hand, timing, rng)
        for key, values in _on_normalised_time(taught, arm.period).items():
            columns.setdefault(key, []).append(values)
        columns.setdefault('durations', []).append(np.array(timing.duration))
    return {'beginning': beginning,
            **{f'taught_{key}': np.array(values) for key, values in columns.items()}}


def _on_normalised_time(taught: Any, period: float) -> Data:
    """`SAMPLES` moments of the motion, without the rest before and after it."""
    from gdmp_ros.sim.teaching import REST_S as REST
    begin, end = round(REST / period), len(taught.times) - round(REST / period)
    at = np.linspace(begin, end - 1, SAMPLES).round().astype(int)
    accelerations = savgol_filter(taught.velocities, 61, 2, deriv=1, delta=period, axis=0)
    return {'accelerations': accelerations[at], **{key: getattr(taught, key)[at] for key in (
        'tool', 'positions', 'velocities', 'forces', 'progress', 'joints')}}


def _beginning(arm: Any) -> np.ndarray:
    """Joint positions with the can at its start: guided there without disturbance."""
    from gdmp_ros.sim.teaching import demonstrate, GuidingHand, Timing
    arm.reset()
    still = GuidingHand(lambda _: intention(0.0), lambda _: np.diag([400.0] * 3), 60.0, tremor=0.0)
    taught = demonstrate(arm, 'can', still, Timing(4.0, disturbance=0.0),
                         np.random.default_rng(0))
    return np.asarray(taught.joints[-1])


def learn(data: Data) -> tuple[Skill, Demonstration]:
    """Stiffness from the forces, pose from the mean; a skill on R³ × S³ × SPD(3)."""
    from gdmp_ros.sim.scenes import CAN_MASS
    duration = float(data['taught_durations'].mean())
    times = np.linspace(0.0, duration, SAMPLES)
    records = ForceRecords(times, *(data[f'taught_{key}'] for key in (
        'positions', 'velocities', 'accelerations', 'forces')))
    stiffness = force_stiffness(records, CAN_MASS, HAND_DAMPING).matrices
    tools = data['taught_tool']
    points = []
    for i in range(SAMPLES):
        turns = [S3.align(tool[i, 3:], tools[0, i, 3:]) for tool in tools]
        points.append(TOOL.join(tools[:, i, :3].mean(axis=0), S3.mean(turns), stiffness[i]))
    mean = Demonstration(times, np.array(points), TOOL).smoothed(2.0)
    return Skill.learn(mean, fit='forcing', end='moving'), mean


def execute(skill: Skill, beginning: np.ndarray) -> Data:
    """Run the impedance loop without ROS; reference and arm at every tick."""
    from gdmp_ros.playback.player import Player
    from gdmp_ros.playback.settings import PlayerSettings
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.closed_loop import ClosedLoop
    from gdmp_ros.sim.scenes import contact_count, watering
    arm = Arm(watering())
    loop = ClosedLoop(arm)
    player = Player(skill, PlayerSettings(rotational_stiffness=(ROTATIONAL,) * 3))
    loop.reset(beginning)
    rows, period = [], arm.period
    player.start(arm.measure().pose.copy())
    for _ in range(round((skill.duration + REST_S) / period)):
        target = player.tick(period)
        if target is None:
            raise RuntimeError('a motion that was started has no reference')
        loop.must_follow(target)
        tick = loop.tick()
        rows.append((target[:7].copy(), tick.measurement.pose.copy(),
                     tick.stiffness.reshape(6, 6)[:3, :3].copy(), tick.measurement.position,
                     arm.site_pose('lip')[2], contact_count(arm.model, arm.data, 'tray')))
    names = ('reference', 'pose', 'stiffness', 'joints', 'lip', 'contacts')
    return {name: np.array(column) for name, column in zip(names, zip(*rows))}


def run(settings: Settings) -> Data:
    """Teach, learn, refill; with ``--ros`` through the nodes."""
    from gdmp_ros.sim.scenes import watering
    from gdmp_ros.view.films import render_to
    data = teach()
    skill, mean = learn(data)
    scene, spec = settings.folder / 'fig11-scene.xml', watering()
    spec.key('ready').qpos = data['beginning']
    scene.write_text(spec.to_xml())
    if settings.ros:
        from experiments.paper.through_nodes import execute_skill
        data.update(execute_skill(skill, scene, settings.folder / 'fig11-ros', ROTATIONAL))
    else:
        data.update(execute(skill, data['beginning']))
    data.update({'mean': np.array(mean.points), 'mean_times': mean.times,
                 'times': 1e-3 * np.arange(len(data['pose'])),
                 'holding': np.array([holding(p) for p in data['taught_progress'].mean(axis=0)])})
    missing = render_to(settings.folder / 'fig11-film.webp', data['joints'][::80],
                        data['pose'][::150, :3], scene, 0.08)
    if missing:
        print(missing)
    return data


def tracking(data: Data) -> tuple[np.ndarray, np.ndarray]:
    """Distance [m] and angle [rad] between reference and arm at every tick."""
    away = np.linalg.norm(data['reference'][:, :3] - data['pose'][:, :3], axis=1)
    turned = [2.0 * S3.distance(S3.align(a, b), b)
              for a, b in zip(data['pose'][:, 3:], data['reference'][:, 3:])]
    return away, np.array(turned)


def verdict(data: Data) -> Verdict:
    """Tracking, depth of the lip, contacts, and the stiffness beside that of the hand."""
    from gdmp_ros.sim.scenes import WATER_LINE
    away, turned = tracking(data)
    profile = data['mean'][:, 7:].reshape(-1, 3, 3)
    hold = spd_distances(profile, data['holding'])
    under = WATER_LINE - data['lip']
    eigenvalues = np.linalg.eigvalsh(profile)
    measured = {'tracking_position_largest_m': away.max(),
                'tracking_position_rms_m': np.sqrt(np.mean(away ** 2)),
                'tracking_rotation_largest_rad': turned.max(),
                'lip_under_the_water_m': under.max(), 'lip_above_at_the_end_m': -under[-1],
                'seconds_under_water': 1e-3 * np.count_nonzero(under > 0.0),
                'contacts_with_the_tray': int(data['contacts'].sum()),
                'stiffness_eigenvalues_from_N/m': eigenvalues.min(),
                'stiffness_eigenvalues_to_N/m': eigenvalues.max(),
                'stiffness_distance_from_the_hand_mean': np.mean(hold),
                'demonstrations': len(data['taught_tool'])}
    holds = (away.max() <= 0.01 and turned.max() <= 0.05 and under.max() > 0.0
             and under[-1] < 0.0 and np.mean(hold) < 0.15
             and measured['contacts_with_the_tray'] == 0)
    return Verdict(bool(holds), measured, (
        'The hand is simulated, so its stiffness is known: the last but one figure is the mean '
        'geodesic distance of the estimate from it.'))


def draw(data: Data) -> dict[str, Any]:
    """Position, orientation and stiffness: five demonstrations, the skill and the arm."""
    figure, axes = plots.panels(2, 2, (6.2, 3.4))
    times = data['times']
    for tool in data['taught_tool']:
        seconds = np.linspace(0.0, data['mean_times'][-1], len(tool))
        axes[0, 0].plot(seconds, tool[:, :3], color='0.8', lw=0.8)
        axes[0, 1].plot(seconds, [S3.align(q, data['taught_tool'][0, 0, 3:])
                                  for q in tool[:, 3:]], color='0.8', lw=0.8)
    for panel, part, names, label in ((axes[0, 0], slice(0, 3), 'xyz', 'position [m]'),
                                      (axes[0, 1], slice(3, 7), 'wxyz', 'quaternion [1]')):
        panel.plot([], [], color='0.8', label='5 demonstrations')
        panel.plot(times, data['reference'][:, part], color='black', lw=0.8, ls=(0, (5, 3)))
        panel.plot([], [], color='black', lw=0.8, ls=(0, (5, 3)), label='G-DMP')
        sign = np.sign(np.sum(data['pose'][0, 3:] * data['reference'][0, 3:]))
        measured = data['pose'] * np.where(np.arange(7) < 3, 1.0, sign)
        plots.series(panel, times, measured[:, part], [f'arm {n}' for n in names], label)
        panel.legend(fontsize=7, ncols=2)
    profile = data['mean'][:, 7:]
    panel = axes[1, 0]
    for i, (column, name) in enumerate(((0, 'K11'), (4, 'K22'), (8, 'K33'), (1, 'K12'))):
        panel.plot(data['mean_times'], profile[:, column], ls=plots.STYLES[i],
                   color=plots.INK[i], label=name)
        panel.plot(data['mean_times'], data['holding'].reshape(-1, 9)[:, column], color='0.6',
                   lw=0.7)
    panel.plot([], [], color='0.6', lw=0.7, label="the hand's own")
    panel.set(xlabel='time [s]', ylabel='stiffness [N/m]')
    panel.legend(fontsize=7, ncols=3)
    _errors(axes[1, 1], data)
    return {'fig11': figure}


def _errors(panel: Any, data: Data) -> None:
    from gdmp_ros.sim.scenes import WATER_LINE
    away, turned = tracking(data)
    panel.plot(data['times'], 1e3 * away, '-', color='black', label='position error [mm]')
    panel.plot(data['times'], 1e3 * turned, ':', color='black', label='rotation error [mrad]')
    panel.plot(data['times'], 100.0 * (data['lip'] - WATER_LINE), '--', color=plots.INK[0],
               label='lip above the water [cm]')
    panel.axhline(0.0, color=plots.INK[0], lw=0.6)
    panel.set(xlabel='time [s]', ylabel='error, height [mm, mrad, cm]')
    panel.legend(fontsize=7)

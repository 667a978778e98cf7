"""
A motion around what stands in its way: the same skill, with another path and its timing.

Where the plain path comes nearer to a volume than its margin, a way around is searched
(`gdmp_ros.scene.route`). The tool moves along it as fast as along the plain path there, so the
motion takes longer; orientation and stiffness go with the progress. The result is learned as any
other motion: goals are switched, and it is stopped and slowed down, as usual.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d

from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.scene.route import clearances, Grid, lengths_of, points_at, tight, Tool
from gdmp_ros.scene.scene import Scene

#: Samples of a path; margins that are tried, the first that leaves a way is taken.
SAMPLES, MARGINS = 401, (2.0, 1.6)
#: The way leaves the plain path this share of its samples before what is in the way, and the
#: widths with which its corners are rounded.
LEAD, WIDTHS = 0.06, (0.03, 0.015, 0.006, 0.0)
#: Share of the path within which the tempo changes.
EARLIER = 0.05
#: Least number of basis functions of what is learned.
LEAST_BASIS = 120


class BlockedError(DataError):
    """No way was found around a volume."""


class Detour(NamedTuple):
    """
    A skill that keeps its distance.

    :ivar skill: with the plain path, or with another one
    :ivar around: names of the volumes that were in the way; empty: the path is the plain one
    :ivar least: least distance of the tool from a volume, less its margin [m]
    :ivar longer: length of the path / length of the plain one
    """

    skill: Skill
    around: tuple[str, ...]
    least: float
    longer: float


class _Path(NamedTuple):
    times: np.ndarray
    points: np.ndarray
    positions: np.ndarray
    turns: np.ndarray


def detour(skill: Skill, scene: Scene, tool: Tool, lowest: float = 0.0,
           start: np.ndarray | None = None, goal: np.ndarray | None = None) -> Detour:
    """
    Return the skill with a path around the volumes of a scene.

    One with task frames becomes a plain one, with the frames where they are.

    :param skill: with a position, and usually an orientation; not rhythmic
    :param scene: in the frame of the skill
    :param tool: shape that must not come nearer than the margins
    :param lowest: height below which no way is searched, unless the path is there [m]
    :param start: point; its own by default
    :param goal: the same
    :returns: with the skill that was given, if its path is free
    :raises BlockedError: if there is no way
    :raises DataError: for a skill that has no position, or repeats a cycle
    """
    if not leads_around(skill):
        raise DataError('only a skill with a position in three dimensions is led around '
                        'obstacles, not a rhythmic one')
    volumes, tool = scene.packed(tool.bits), tool.carrying(scene.carried)
    path = _sampled(skill, start, goal)
    left, which = clearances(volumes, tool, path.positions, path.turns)
    if left.min() > 0.0:
        return Detour(skill, (), float(left.min()), 1.0)
    names = tuple(dict.fromkeys(scene.names[k] for k in which[left <= 0.0]))
    for at, what in ((0, 'start'), (-1, 'goal')):
        if left[at] <= 0.0:
            raise BlockedError(f'blocked by {scene.names[which[at]]}: the tool is '
                               f'{_mm(left[at])} inside its margin at the {what}')
    fixed = [round(event.progress * (SAMPLES - 1)) for event in skill.events]
    for margins in MARGINS:
        way = _way(path, volumes, tool, margins, lowest, fixed)
        if way is None:
            continue
        for width in WIDTHS:
            changed, longer = _learned(skill, path, _rounded(path, way, width, fixed), names)
            found = _sampled(changed)
            least = float(clearances(volumes, tool, found.positions, found.turns)[0].min())
            if least > 0.0:
                return Detour(changed, names, least, longer)
    raise BlockedError(f'blocked by {", ".join(names)}: there is no way around')


def _part(skill: Skill, name: str) -> slice | None:
    """Where the numbers of a factor are in a point; a manifold that is no product is one."""
    at = 0
    for known, factor in zip(skill.manifold.names, skill.manifold.factors):
        if known == name or (name == 'position' and len(skill.manifold.factors) == 1
                             and factor.is_flat and factor.point_size == 3):
            return slice(at, at + factor.point_size)
        at += factor.point_size
    return None


def leads_around(skill: Skill) -> bool:
    """Whether a skill can be led around anything: one of a position that is not rhythmic."""
    part = _part(skill, 'position')
    return (part is not None and part.stop - part.start == 3 and not skill.rhythmic)


def _mm(distance: float) -> str:
    return f'{-1e3 * distance:.0f} mm'


def _sampled(skill: Skill, start: np.ndarray | None = None, goal: np.ndarray | None = None
             ) -> _Path:
    times = np.linspace(0.0, skill.duration, SAMPLES)
    points = skill.rollout(start=start, goal=goal).sample(times).points.reshape(SAMPLES, -1)
    orientation = _part(skill, 'orientation')
    turns = (np.array([1.0, 0.0, 0.0, 0.0]) if orientation is None
             or orientation.stop - orientation.start != 4 else points[:, orientation])
    return _Path(times, points, points[:, _part(skill, 'position')].copy(), np.broadcast_to(
        turns, (SAMPLES, 4)))


def _way(path: _Path, volumes: np.ndarray, tool: Tool, margins: float, lowest: float,
         fixed: list[int]) -> np.ndarray | None:
    """
    Return positions around what is in the way, one for each sample of the path.

    :param fixed: samples that stay where they are
    """
    left, _ = clearances(volumes, tool, path.positions, path.turns, margins)
    result = path.positions.copy()
    for first, last in _parts_to_lead(path, volumes, tool, left > 0.0, fixed):
        middle = path.turns[(first + last) // 2]
        grid = Grid(volumes, tool, path.positions[first:last + 1], middle, margins, lowest)
        found = grid.shortest(path.positions[first], path.positions[last])
        if found is None:
            return None
        found = np.vstack([path.positions[first], found, path.positions[last]])
        found = tight(volumes, tool, found, middle, margins)
        # As far along the way as along the plain path.
        along = lengths_of(path.positions[first:last + 1])
        share = along / along[-1] if along[-1] > 1e-3 else np.linspace(0.0, 1.0, len(along))
        result[first:last + 1] = points_at(found, share)
    return result


def _parts_to_lead(path: _Path, volumes: np.ndarray, tool: Tool, free: np.ndarray,
                   fixed: list[int]) -> list[tuple[int, int]]:
    """
    Return the parts of a path that are led elsewhere: first and last sample of each.

    :param free: samples from which a way may leave, and to which it may return
    """
    near = clearances(volumes, tool, path.positions, path.turns)[0] <= 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
    lead, parts = round(LEAD * SAMPLES), list[tuple[int, int]]()
    for begin, end in zip(edges[::2], edges[1::2]):
        least = max([0, *(k for k in fixed if k < begin)])
        most = min([SAMPLES - 1, *(k for k in fixed if k >= end)])
        first, last = max(begin - lead, least), min(end - 1 + lead, most)
        while first > least and not free[first]:
            first -= 1
        while last < most and not free[last]:
            last += 1
        if parts and first < parts[-1][1]:
            first, _ = parts.pop()
        parts.append((int(first), int(last)))
    return parts


def _rounded(path: _Path, way: np.ndarray, width: float, fixed: list[int]) -> np.ndarray:
    """Round the corners of a way, but leave samples that stay where they are."""
    if not width:
        return way
    change = gaussian_filter1d(way - path.positions, width * SAMPLES, axis=0, mode='constant')
    for k in fixed:
        away = (np.arange(SAMPLES) - k) / (width * SAMPLES)
        change *= -np.expm1(-0.5 * away ** 2)[:, None]
    return np.asarray(path.positions + change)


def _learned(skill: Skill, path: _Path, positions: np.ndarray, names: tuple[str, ...]
             ) -> tuple[Skill, float]:
    """Learn the skill along other positions."""
    plain, new = np.diff(lengths_of(path.positions)), np.diff(lengths_of(positions))
    # Where the plain path stands, or nearly, the time stays.
    usual = plain.max() * 0.1
    slower = np.maximum((new + usual) / (plain + usual), 1.0)
    # A tempo that jumps would be an acceleration; nowhere is the tool faster than before.
    slower = maximum_filter1d(slower, round(EARLIER * SAMPLES), mode='nearest')
    slower = gaussian_filter1d(slower, 0.25 * EARLIER * SAMPLES, mode='nearest')
    times = np.concatenate([[0.0], np.cumsum(slower * np.diff(path.times))])
    points = path.points.copy()
    points[:, _part(skill, 'position')] = positions
    learned = Skill.learn(
        Demonstration(times, points.reshape(-1, *skill.manifold.point_shape), skill.manifold),
        max(LEAST_BASIS, len(skill.weights)), skill.gains.alpha_z, skill.gains.alpha_x,
        skill.connection, alpha_g=skill.gains.alpha_g,
        provenance={**skill.provenance, 'around': list(names)})
    before, at = path.times / path.times[-1], times / times[-1]
    events = [event._replace(progress=float(np.interp(event.progress, before, at)))
              for event in skill.events]
    return learned.with_events(events), float(new.sum() / plain.sum())

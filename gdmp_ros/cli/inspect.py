"""Show the contents of a bag, a skill file, or a file of another program.

examples:
  gdmp inspect demos/GShape_1
  gdmp inspect run --pose-topic /panda_sim/measured_pose
  gdmp inspect skill.json
  gdmp inspect data.hdf5
"""
from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from gdmp_ros.cli.arguments import add_pose_topic
from gdmp_ros.errors import DataError
from gdmp_ros.util.terminal import progress, table

if TYPE_CHECKING:
    import numpy as np

    from gdmp_ros.dmp.skill import Skill


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('path', type=Path, metavar='BAG|SKILL')
    add_pose_topic(parser)


def run(options: argparse.Namespace) -> None:
    """Print a bag if the path is a folder, otherwise a skill."""
    path = options.path
    from gdmp_ros.data import bags, episodes
    if episodes.is_foreign(path):
        _print_foreign(path)
        return
    if not path.exists():
        raise DataError(f'{path}: no such bag or skill file')
    if path.is_dir() or path.suffix in bags.FILES:
        _print_bag(path, options.pose_topic)
    else:
        _print_skill(path)


def _print_foreign(path: Path) -> None:
    from gdmp_ros.data import episodes
    sources = episodes.sources(path)
    table(str(path), ['episode', 'samples', 'duration [s]', 'how it is read'],
          [_episode_row(source) for source in sources])


def _episode_row(source: Path) -> list[object]:
    from gdmp_ros.data import episodes
    try:
        result = episodes.read(source)
    except DataError as error:
        return [source.name, '', '', f'refused: {error}']
    contexts = result.demonstration
    return [source.name, len(contexts.times), f'{contexts.duration:.3f}', '; '.join(result.notes)]


def _print_bag(path: Path, pose_topic: str) -> None:
    import numpy as np

    from gdmp_ros.data import bags, recordings
    table(str(path), ['topic', 'type', 'messages'], bags.topics(path))
    try:
        with progress('reading', 1):
            recording = recordings.read(path, pose_topic)
    except DataError as error:
        print(f'not a demonstration of a tool: {error}')
        return
    demonstration = recording.demonstration
    points = demonstration.points
    box = np.ptp(points[:, :3], axis=0)
    rows: list[list[object]] = [
        ['frame', recording.frame], ['samples', len(points)],
        ['duration [s]', f'{demonstration.duration:.3f}'],
        ['spacing', 'uniform' if demonstration.is_uniform else 'irregular (is resampled)'],
        ['extent x, y, z [m]', ', '.join(f'{side:.3f}' for side in box)]]
    if len(demonstration.manifold.factors) > 2:
        size = demonstration.manifold.factors[2].size
        values = np.linalg.eigvalsh(points[:, 7:].reshape(-1, size, size))
        rows.append(['stiffness eigenvalues [N/m, Nm/rad]',
                     f'{values.min():.1f} … {values.max():.1f}'])
    table('demonstration', ['', 'value'], rows)


def _print_skill(path: Path) -> None:
    from gdmp_ros.dmp.skill import Skill
    skill = Skill.load(path)
    gains = skill.gains
    rows: list[list[object]] = [
        ['manifold', repr(skill.manifold)], ['factors', ', '.join(skill.manifold.names)],
        ['connection', skill.connection],
        ['period [s]' if skill.rhythmic else 'duration [s]', f'{skill.duration:.3f}'],
        ['basis functions', skill.n_basis], ['grid steps', skill.steps],
        ['alpha_z, alpha_x, alpha_g',
         f'{gains.alpha_z:g}, {gains.alpha_x:g}, {gains.alpha_g:g}'],
        ['segments', _segments(skill)],
        ['start', _numbers(skill.start)],
        ['centre' if skill.rhythmic else 'goal', _numbers(skill.goal)]]
    if skill.variation is not None and skill.variation.contexts is not None:
        contexts = skill.variation.contexts
        rows += [[f'context {name}', f'{low:g} … {high:g}'] for name, low, high in zip(
            contexts.names, contexts.takes.min(axis=0), contexts.takes.max(axis=0))]
    rows += [[f'coupling {coupling.kind}{", the first leads" if coupling.leads else ""}',
              f'{", ".join(coupling.second)} to {", ".join(coupling.first)}: '
              f'{" ".join(f"{number:.4g}" for number in coupling.relation)}']
             for coupling in skill.couplings]
    rows += [[key, value] for key, value in skill.provenance.items()]
    table(str(path), ['', 'value'], rows)


def _segments(skill: Skill) -> str:
    if len(skill.segments) == 1:
        return '1'
    at = ', '.join(f'{s:.3f}' for s in skill.segments.ends)
    return f'{len(skill.segments)}, split at the cut locus at s = {at}'


def _numbers(point: np.ndarray) -> str:
    return ' '.join(f'{number:.4g}' for number in point.reshape(-1))

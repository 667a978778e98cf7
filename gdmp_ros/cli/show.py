"""Show a recording or a skill: as text, as a picture, as a film, or as a page.

The name of the result determines what is made; without -o the contents are printed.

A picture (.png, .pdf, .svg) of a skill, a sequence or a demonstration: every factor over time, and
the path with stiffness ellipsoids. A step of a sequence that waits for a signal gets it after two
cycles or seconds. A picture of a run is the arm at its end.

A film (.mp4, .webp, .gif) of a recorded run, or of a skill that the simulated arm executes.
Without a screen, EGL or OSMesa draws the pictures (Debian: libegl1 or libosmesa6).

A page (.html) about a recorded run or a demonstration: path in space, errors, stiffness, energy
and lateness over time, and the events. It is one file and needs no network.

examples:
  gdmp show demos/GShape_1
  gdmp show skill.json
  gdmp show data.hdf5
  gdmp show skill.json -o skill.png --demonstrations demos
  gdmp show skill.json -o skill.webp --playback 2
  gdmp show insert.json -o insert.webp --object hole 0.5 0.1 0.2 0.92 0 0 0.38
  gdmp show out/demo/run -o run.mp4
  gdmp show out/demo/run -o run.html
  gdmp show takes/take_001 -o take.html --skill skill.json
"""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

from gdmp_ros.choices import SEQUENCES
from gdmp_ros.cli.arguments import (
    add_import,
    add_objects,
    add_output,
    add_pose_topic,
    add_robot,
    among_objects,
    check_output,
    import_settings,
    number,
)
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.util.optional_imports import extra, optional_import
from gdmp_ros.util.terminal import progress, table

if TYPE_CHECKING:
    import numpy as np

    from gdmp_ros.data.columns import Import
    from gdmp_ros.dmp.frames import View
    from gdmp_ros.dmp.skill import Skill

PICTURES, FILMS, PAGES = ('.png', '.pdf', '.svg'), ('.mp4', '.webp', '.gif'), ('.html',)
#: Episodes that are listed.
MOST_ROWS = 20
#: Largest number of spheres along the path of a film.
_SPHERES = 150


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('source', type=Path, metavar='BAG|SKILL|SEQUENCE|FILE')
    add_output(parser, 'FILE', f'what is made: {", ".join((*PICTURES, *FILMS, *PAGES))}',
               required=False)
    add_pose_topic(parser)
    add_robot(parser)
    add_import(parser, has_model=True)
    add_objects(parser)
    parser.add_argument('--demonstrations', type=Path, nargs='+', default=[], metavar='BAG',
                        help='picture of a skill: draw demonstrations of a tool below it')
    parser.add_argument('--skill', type=Path, metavar='SKILL',
                        help='page: a skill of several takes; show where 95 %% of takes with this '
                             'start and goal would be')
    parser.add_argument('--playback', type=number(above=0.0, high=100.0), default=1.0, metavar='X',
                        help='film: factor of its speed (default %(default)g)')
    parser.add_argument('--fps', type=number(above=0.0, high=120.0), default=25.0, metavar='N',
                        help='film: pictures per second (default %(default)g)')
    parser.add_argument('--model', default='', metavar='MODEL',
                        help='film: another arm: MJCF file, menagerie:NAME, '
                             'robot_descriptions:NAME')


def run(options: argparse.Namespace) -> int | None:
    """Print the contents, or make what the name of the result says."""
    from gdmp_ros.data import bags
    source, output = options.source, options.output
    check_output(output, *PICTURES, *FILMS, *PAGES)
    is_bag = source.is_dir() or source.suffix in bags.FILES
    if output is None:
        return _print(options, is_bag)
    from gdmp_ros.data import runs
    if output.suffix in PAGES:
        with optional_import(extra('report')):
            from gdmp_ros.view import pages
        what = pages.write_report(source, output, options.namespace, options.skill)
        print(f'wrote {output}, about {what}')
    elif output.suffix in FILMS or (is_bag and runs.is_run(source, options.namespace)):
        _film(options, is_bag)
    else:
        _draw(options)
        print(f'wrote {output}')
    return None


def _print(options: argparse.Namespace, is_bag: bool) -> int | None:
    from gdmp_ros.data import episodes
    source = options.source
    if episodes.is_foreign(source):
        return _print_foreign(source, import_settings(options))
    if not source.exists():
        raise DataError(f'{source}: no such bag or skill file')
    if is_bag:
        _print_bag(source, options.pose_topic, import_settings(options))
    elif source.suffix in SEQUENCES:
        _print_sequence(source)
    else:
        _print_skill(source, options.objects)
    return None


def _draw(options: argparse.Namespace) -> None:
    """Draw a skill, a sequence or a demonstration."""
    from gdmp_ros.data import episodes, recordings, takes
    from gdmp_ros.dmp.skill import Skill
    from gdmp_ros.view import plots, skill_plots
    source, reading = options.source, import_settings(options)
    if source.suffix in SEQUENCES:
        from gdmp_ros.data.sequences import read_sequence
        plots.save(skill_plots.sequence_figure(read_sequence(source)), options.output)
    elif source.suffix == '.json' and not episodes.is_foreign(source):
        skill = among_objects(Skill.load(source), options.objects)
        demos = [recordings.read(bag, settings=reading).demonstration
                 for given in options.demonstrations for bag in takes.bags_in(given)]
        plots.save(skill_plots.skill_figure(skill, demos), options.output)
    else:
        demo = recordings.read(source, options.pose_topic, settings=reading).demonstration
        plots.save(skill_plots.draw_motion(demo.manifold, demo.times, demo.points).figure,
                   options.output)


def _film(options: argparse.Namespace, is_bag: bool) -> None:
    """Choose the pictures and draw them."""
    import numpy as np
    with optional_import(extra('sim')):
        from gdmp_ros.view.films import render_to
        times, joints, path = _recorded(options) if is_bag else _executed(options)
    frame_times = np.arange(times[0], times[-1], options.playback / options.fps)
    postures = joints[np.clip(np.searchsorted(times, frame_times), 0, len(times) - 1)]
    still = options.output.suffix in PICTURES
    options.output.absolute().parent.mkdir(parents=True, exist_ok=True)
    with progress('drawing', 1):
        missing = render_to(options.output, postures[-1] if still else postures,
                            path[::max(1, len(path) // _SPHERES)], options.model,
                            1.0 / options.fps)
    if missing is not None:
        raise GdmpError(missing)
    print(f'wrote {options.output}: {1 if still else len(postures)} pictures')


class _Motion(NamedTuple):
    """Times [s], joint positions [rad] and tool positions [m]."""

    times: np.ndarray
    joints: np.ndarray
    path: np.ndarray


def _recorded(options: argparse.Namespace) -> _Motion:
    from gdmp_ros.data import runs
    run = runs.read(options.source, options.namespace)
    return _Motion(1e-9 * (run.state_stamps - run.state_stamps[0]), run.joints, run.poses[:, :3])


def _executed(options: argparse.Namespace) -> _Motion:
    import numpy as np

    from gdmp_ros.dmp.skill import Skill
    skill = among_objects(Skill.load(options.source), options.objects)
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.execution import execute
    arm = Arm(options.model)
    done = execute(skill, arm)
    return _Motion(arm.period * np.arange(len(done.joints)), done.joints, done.measured[:, :3])


def _print_foreign(path: Path, reading: Import) -> int:
    """Print the episodes of a file; 1 if none can be read."""
    from gdmp_ros.data import episodes
    sources = episodes.sources(path)
    with progress('reading', len(sources)) as step:
        rows: list[Sequence[object]] = []
        for source in sources:
            rows.append(_episode_row(source, reading))
            step()
    shown = rows if len(rows) <= MOST_ROWS else [*rows[:MOST_ROWS], [
        f'and {len(rows) - MOST_ROWS} more', '', '', '']]
    table(str(path), ['episode', 'samples', 'duration [s]', 'how it is read'], shown)
    refused = sum(not row[1] for row in rows)
    if refused:
        print(f'{refused} of {len(rows)} episodes cannot be read')
    return int(refused == len(rows))


def _episode_row(source: Path, reading: Import) -> list[object]:
    from gdmp_ros.data import episodes
    try:
        result = episodes.read(source, reading)
    except DataError as error:
        return [source.name, '', '', f'refused: {error}']
    contexts = result.demonstration
    return [source.name, len(contexts.times), f'{contexts.duration:.3f}', '; '.join(result.notes)]


def _print_bag(path: Path, pose_topic: str, reading: Import) -> None:
    import numpy as np

    from gdmp_ros.data import bags, recordings
    table(str(path), ['topic', 'type', 'messages'], bags.topics(path))
    try:
        with progress('reading', 1):
            recording = recordings.read(path, pose_topic, settings=reading)
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


def _print_sequence(path: Path) -> None:
    from gdmp_ros.data.sequences import read_sequence
    sequence = read_sequence(path)
    table(str(path), ['step', 'kind', 'ends with'],
          [[step.name, type(step).__name__.removesuffix('Step').lower(),
            getattr(step, 'until', '') or ''] for step in sequence.steps])


def _print_skill(path: Path, objects: Sequence[Sequence[str]]) -> None:
    from gdmp_ros.dmp.skill import Skill
    skill = among_objects(Skill.load(path), objects)
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
    rows += [[f'task frame {view.name}', _matters(skill, view)] for view in skill.views]
    rows += [[key, value] for key, value in skill.provenance.items()]
    table(str(path), ['', 'value'], rows)


def _matters(skill: Skill, view: View) -> str:
    """Where a frame was shown, and where it matters most."""
    import numpy as np
    heaviest = [view.shares >= other.shares for other in skill.views if other is not view]
    places = np.linspace(0.0, 1.0, len(view.shares))
    at = places[np.logical_and.reduce(heaviest)[:, 0]]
    most = (f'matters most for s = {min(at):.2f} … {max(at):.2f}' if len(at)
            else 'never matters most')
    said = [_numbers(view.pose), most]
    if view.free_yaw:
        said.append('symmetric about its z axis')
    if view.grasped is not None:
        said.append(f'grasped at s = {view.grasped:.2f}')
    return '; '.join(said)


def _segments(skill: Skill) -> str:
    if len(skill.segments) == 1:
        return '1'
    at = ', '.join(f'{s:.3f}' for s in skill.segments.ends)
    return f'{len(skill.segments)}, split at the cut locus at s = {at}'


def _numbers(point: np.ndarray) -> str:
    return ' '.join(f'{number:.4g}' for number in point.reshape(-1))

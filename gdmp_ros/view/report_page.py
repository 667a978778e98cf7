"""Puts a report together: one HTML file that needs nothing else."""
from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader
import numpy as np

from gdmp_ros import __version__
from gdmp_ros.data import bags, recordings, runs
from gdmp_ros.data import run_analysis as findings
from gdmp_ros.errors import DataError
from gdmp_ros.util.atomic_write import write_text
from gdmp_ros.view import report_figures as drawing

#: More events than this are counted, not marked in the figures.
MOST_MARKS = 40


def write(bag: Path, path: Path, robot: str = '') -> str:
    """
    Write the report of a bag: of a run if it has references and states, else of a demonstration.

    :param robot: namespace of the robot, where the bag has several
    :returns: what it is a report of
    :raises DataError: if the bag cannot be read, holds neither, or the page cannot be written
    """
    is_run = all(runs.streams(bags.topics(bag), robot))
    parts = _run(bag, robot) if is_run else _demonstration(bag)
    page = Environment(loader=PackageLoader('gdmp_ros.report', '.'), autoescape=True)
    text = page.get_template('page.html').render(
        library=drawing.library(), source=str(bag), version=__version__, **parts)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise DataError(f'{path}: cannot write the report: {error.strerror}') from None
    return 'a run' if is_run else 'a demonstration'


def _run(bag: Path, robot: str) -> dict[str, object]:
    run = runs.read(bag, robot)
    events, tracked = findings.events(run), findings.tracking(run)
    marks = events if len(events) <= MOST_MARKS else []
    return {'title': f'Run {bag.name}', 'rows': findings.figures(run, tracked), 'events': events,
            'space': drawing.html(drawing.run_in_space(run), 'space'),
            'time': drawing.html(drawing.run_over_time(run, tracked, marks), 'time')}


def _demonstration(bag: Path) -> dict[str, object]:
    recording = recordings.read(bag)
    shown = recording.demonstration
    length = np.linalg.norm(np.diff(shown.points[:, :3], axis=0), axis=1).sum()
    rows = [('frame', recording.frame), ('duration', f'{shown.duration:.2f} s'),
            ('samples', f'{len(shown.times)}'), ('path', f'{length:.3f} m'),
            ('made of', ', '.join(shown.manifold.names))]
    return {'title': f'Demonstration {bag.name}', 'rows': rows, 'events': [],
            'space': drawing.html(drawing.demonstration_in_space(recording), 'space'),
            'time': drawing.html(drawing.demonstration_over_time(recording), 'time')}

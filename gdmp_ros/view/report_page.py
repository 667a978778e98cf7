"""Report of a bag: one HTML file that needs no network."""
from __future__ import annotations

from pathlib import Path

import numpy as np

from gdmp_ros.data import bags, recordings, run_analysis, run_events, runs
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.playback.prediction import likely_path
from gdmp_ros.view import report_figures as figures
from gdmp_ros.view.pages import write_page

#: Intervals of progress at which a tube is computed.
INTERVALS = 60
#: With more events than this none is marked in the figures.
MOST_MARKS = 40


def write(bag: Path, path: Path, robot: str = '', skill: Path | None = None) -> str:
    """
    Write the report of a bag: of a run if it has references and states, else of a demonstration.

    :param robot: namespace of the robot, if the bag has several
    :param skill: of several takes; shown with the tube in which takes like these lie
    :returns: what the report is about
    :raises DataError: if the bag cannot be read, holds neither, or the page cannot be written; if
        the skill does not know how takes vary
    """
    learned = None if skill is None else Skill.load(skill)
    is_run = all(runs.streams(bags.topics(bag), robot))
    parts = _run(bag, robot, learned) if is_run else _demonstration(bag, learned)
    write_page('report.html', path, 'report', source=str(bag), **parts)
    return 'a run' if is_run else 'a demonstration'


def _likely(skill: Skill | None, poses: np.ndarray) -> figures.Likely | None:
    return None if skill is None else likely_path(skill, poses[0, :7], poses[-1, :7], INTERVALS)


def _run(bag: Path, robot: str, skill: Skill | None) -> dict[str, object]:
    run = runs.read(bag, robot)
    events, tracked = run_events.events(run), run_analysis.tracking(run)
    marks, active = events if len(events) <= MOST_MARKS else [], run_events.limited(run)
    return {'title': 'Run', 'rows': run_analysis.summary(run, tracked),
            'events': events, 'marked': bool(marks), 'limited': active,
            'space': figures.html(figures.run_in_space(run, _likely(
                skill, run.references[run.moving] if run.moving.any() else run.references)),
                'space'),
            'time': figures.html(figures.run_over_time(run, tracked, marks, active), 'time')}


def _demonstration(bag: Path, skill: Skill | None) -> dict[str, object]:
    recording = recordings.read(bag)
    shown = recording.demonstration
    likely = _likely(skill, shown.points)
    length = np.linalg.norm(np.diff(shown.points[:, :3], axis=0), axis=1).sum()
    rows = [('frame', recording.frame), ('duration', f'{shown.duration:.2f} s'),
            ('samples', f'{len(shown.times)}'), ('path', f'{length:.3f} m'),
            ('factors', ', '.join(shown.manifold.names))]
    return {'title': f'Demonstration {bag.name}', 'rows': rows, 'events': [], 'limited': [],
            'space': figures.html(figures.demonstration_in_space(recording, likely), 'space'),
            'time': figures.html(figures.demonstration_over_time(recording, likely), 'time')}

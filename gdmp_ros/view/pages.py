"""Pages as HTML files that need no network: the report of a bag, and of an improvement."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader
import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from gdmp_ros import __version__
from gdmp_ros.data import recordings, runs
from gdmp_ros.dmp.rollout import Rollout
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.improvement.session import Improvement, Judgement
from gdmp_ros.playback.prediction import likely_path
from gdmp_ros.util.files import write_text
from gdmp_ros.view import report_figures as figures
from gdmp_ros.view.report_figures import library
from gdmp_ros.view.style import INK

#: Intervals of progress at which a tube is computed.
INTERVALS = 60
#: With more events than this none is marked in the figures.
MOST_MARKS = 40
#: Skills that are drawn from a distribution, and samples of each motion.
DRAWN, SAMPLES = 12, 100
#: Time after which a browser reads the page of an improvement under way again [s].
REFRESH_S = 5


def write_page(template: str, path: Path, what: str, **parts: Any) -> None:
    """
    Write a page, whole or not at all.

    :param template: file beside this one that extends ``page.html``
    :param what: the page is, for the message
    :param parts: of the template
    :raises DataError: if it cannot be written
    """
    page = Environment(loader=PackageLoader('gdmp_ros.view', '.'), autoescape=True)
    text = page.get_template(template).render(library=library(), version=__version__, **parts)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise DataError(f'{path}: cannot write the {what}: {error.strerror}') from None


def write_report(bag: Path, path: Path, robot: str = '', skill: Path | None = None) -> str:
    """
    Write the report of a bag: of a run if it has references and states, else of a demonstration.

    :param robot: namespace of the robot, if the bag has several
    :param skill: of several takes; shown with the tube in which takes like these lie
    :returns: what the report is about
    :raises DataError: if the bag cannot be read, holds neither, or the page cannot be written; if
        the skill does not know how takes vary
    """
    learned = None if skill is None else Skill.load(skill)
    is_run = runs.is_run(bag, robot)
    parts = _run(bag, robot, learned) if is_run else _demonstration(bag, learned)
    write_page('report.html', path, 'report', source=str(bag), **parts)
    return 'a run' if is_run else 'a demonstration'


def _likely(skill: Skill | None, poses: np.ndarray) -> figures.Likely | None:
    return None if skill is None else likely_path(skill, poses[0, :7], poses[-1, :7], INTERVALS)


def _run(bag: Path, robot: str, skill: Skill | None) -> dict[str, object]:
    run = runs.read(bag, robot)
    events, tracked = runs.events(run), runs.tracking(run)
    marks, active = events if len(events) <= MOST_MARKS else [], runs.limited_times(run)
    return {'title': 'Run', 'rows': runs.summary(run, tracked),
            'events': events, 'marked': bool(marks), 'limited': active,
            'space': figures.html(figures.run_in_space(run, _likely(
                skill, run.references[run.moving] if run.moving.any() else run.references)),
                'space'),
            'time': figures.html(figures.run_over_time(run, tracked, marks, active), 'time')}


def _demonstration(bag: Path, skill: Skill | None) -> dict[str, object]:
    recording = recordings.read(bag)
    demo = recording.demonstration
    likely = _likely(skill, demo.points)
    length = np.linalg.norm(np.diff(demo.points[:, :3], axis=0), axis=1).sum()
    rows = [('frame', recording.frame), ('duration', f'{demo.duration:.2f} s'),
            ('samples', f'{len(demo.times)}'), ('path', f'{length:.3f} m'),
            ('factors', ', '.join(demo.manifold.names))]
    return {'title': f'Demonstration {bag.name}', 'rows': rows, 'events': [], 'limited': [],
            'space': figures.html(figures.demonstration_in_space(recording, likely), 'space'),
            'time': figures.html(figures.demonstration_over_time(recording, likely), 'time')}


def write_improvement(state: Improvement, path: Path, done: bool) -> None:
    """
    Write the page; while the improvement is under way a browser shows it anew by itself.

    :raises DataError: if it cannot be written
    """
    write_page('improvement.html', path, 'page', title=f'Improvement: {state.task.name}',
               source=f'Task {state.task.name}', refresh=None if done else REFRESH_S,
               rows=_rows(state), ended=_ended(state),
               costs=figures.html(costs_figure(state), 'costs'),
               distribution=figures.html(distribution_figure(state), 'distribution'))


def _rows(state: Improvement) -> list[tuple[str, str]]:
    effort = state.effort
    rows = [('task', state.task.name), ('search', state.search_name),
            ('what varies', f'{state.variables.size} numbers'),
            ('roll-outs', f'{state.rollouts} of {effort.rollouts}: {effort.updates} updates, '
             f'{effort.samples} skills, {effort.situations} situations of each'),
            ('seed', str(state.seed))]
    for name, judged in (('before', state.before), ('after', state.after)):
        if judged is not None:
            rows.append((name, described(judged)))
    return rows


def described(judged: Judgement) -> str:
    """A judgement in words."""
    ended = sum(cost is None for cost in judged.costs)
    words = [] if judged.median is None else [f'median cost {judged.median:.3g}']
    if judged.success is not None:
        words.append(f'success {judged.success:.0%}')
    if ended:
        words.append(f'{ended} ended early')
    return f'{", ".join(words)} (of {len(judged.costs)} roll-outs not used for learning)'


def _ended(state: Improvement) -> list[tuple[int, str]]:
    """Why roll-outs were ended early, by update, from 1 on."""
    return [(number, reason) for number, update in enumerate(state.updates, 1)
            for reason in dict.fromkeys(update.ended)]


def costs_figure(state: Improvement) -> go.Figure:
    """Costs over the roll-outs, and how far the search looks."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.08)
    each = state.effort.situations
    known, lost, medians, ends = [], [], [], []
    for number, update in enumerate(state.updates):
        first = number * len(update.costs) * each
        at = first + each * np.arange(1, len(update.costs) + 1)
        known += [(x, cost) for x, cost in zip(at, update.costs) if cost is not None]
        lost += [x for x, cost in zip(at, update.costs) if cost is None]
        ends.append(at[-1])
        costs = [cost for cost in update.costs if cost is not None]
        medians.append(float(np.median(costs)) if costs else None)
    x, y = zip(*known) if known else ((), ())
    figure.add_scatter(x=x, y=y, mode='markers', name='a skill', marker={'color': INK[0],
                                                                        'size': 5}, row=1, col=1)
    figure.add_scatter(x=ends, y=medians, name='median of an update', line={'color': INK[1]},
                       row=1, col=1)
    if lost:
        figure.add_scatter(x=lost, y=[max(y, default=1.0)] * len(lost), mode='markers',
                           name='ended early', marker={'symbol': 'x', 'color': INK[3]},
                           row=1, col=1)
    spread = np.array([update.deviations for update in state.updates])
    for share, name in ((10, 'smallest 10 %'), (50, 'median'), (90, 'largest 10 %')):
        figure.add_scatter(x=ends, y=np.percentile(spread, share, axis=1), name=name,
                           line={'color': INK[2], 'dash': 'solid' if share == 50 else 'dot'},
                           row=2, col=1)
    figure.update_yaxes(title='cost', row=1, col=1)
    figure.update_yaxes(title='deviation / first one', rangemode='tozero', row=2, col=1)
    figure.update_xaxes(title='roll-outs', row=2, col=1)
    figure.update_layout(height=520, margin={'t': 20})
    return figure


def distribution_figure(state: Improvement) -> go.Figure:
    """Skills drawn from the distribution before and after, coordinate by coordinate."""
    skill, rng = state.variables.skill, np.random.default_rng(0)
    names = list(skill.manifold.names)
    panels = [(name, part) for name, part in zip(names, skill.manifold.point_slices)]
    figure = make_subplots(rows=len(panels), cols=1, shared_xaxes=True, vertical_spacing=0.05,
                           subplot_titles=[name for name, _ in panels])
    before = np.zeros(state.variables.size), np.eye(state.variables.size)
    after = state.search.mean, state.search.covariance
    for (mean, covariance), name, ink in ((before, 'before', INK[1]), (after, 'after', INK[0])):
        drawn = rng.multivariate_normal(mean, covariance, DRAWN, method='eigh')
        for number, values in enumerate([*drawn, mean]):
            best = number == DRAWN
            try:
                points = _points(state.variables.apply(values))
            except GdmpError:
                continue
            for row, (factor, part) in enumerate(panels, 1):
                for column in _columns(points[:, part], factor):
                    figure.add_scatter(
                        x=np.linspace(0.0, 1.0, SAMPLES), y=column, opacity=1.0 if best else 0.25,
                        line={'color': ink, 'width': 2.5 if best else 1}, legendgroup=name,
                        name=name, showlegend=best and row == 1, row=row, col=1)
                    # One entry in the legend for all curves of a distribution.
                    best = best and row != 1
                best = number == DRAWN
    figure.update_xaxes(title='progress', row=len(panels), col=1)
    figure.update_layout(height=60 + figures.PANEL_PX * len(panels), margin={'t': 40})
    return figure


def _points(skill: Skill) -> np.ndarray:
    times = np.linspace(0.0, skill.duration, SAMPLES)
    return np.asarray(Rollout(skill).sample(times).points.reshape(SAMPLES, -1))


def _columns(points: np.ndarray, factor: str) -> np.ndarray:
    """Curves of a factor: of a stiffness its diagonal, of others all coordinates."""
    size = int(round(np.sqrt(points.shape[1])))
    if factor == 'stiffness' and size * size == points.shape[1]:
        return points.reshape(-1, size, size).diagonal(axis1=1, axis2=2).T
    return points.T

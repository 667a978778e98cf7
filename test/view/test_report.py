"""A report is one page that a browser opens without the network and without an error."""
import re
import shutil
import subprocess

import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.data import recordings, runs
from gdmp_ros.errors import DataError
from gdmp_ros.view import pages, plots, report_figures, style
from test.recorded_run import NS, recorded_run

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which(
    'google-chrome')
FLAGS = ('--headless=new', '--no-sandbox', '--disable-gpu', '--use-angle=swiftshader',
         '--enable-unsafe-swiftshader', '--disable-background-networking', '--disable-sync',
         '--disable-component-update', '--disable-quic', '--no-first-run',
         '--enable-logging=stderr', '--virtual-time-budget=20000')


def test_no_two_of_nine_lines_look_alike():
    _, axes = plots.panels()
    plots.series(axes[0, 0], np.arange(2.0), np.zeros((2, 9)), list('abcdefghi'), 'rotation')
    assert len({(line.get_color(), str(line._dash_pattern))
                for line in axes[0, 0].get_lines()}) == 9


def test_ellipsoids_are_long_where_the_arm_is_stiff():
    positions = np.column_stack([np.linspace(0, 1, 50), np.zeros(50), np.zeros(50)])
    matrices = np.tile(np.diag([100.0, 800.0, 200.0]), (50, 1, 1))
    drawn = report_figures._stiffness(positions, matrices)
    assert np.nanmax(drawn.y) == pytest.approx(style.ELLIPSOID_M)
    assert np.nanmax(drawn.z) == pytest.approx(style.ELLIPSOID_M / 4)


@pytest.fixture(scope='module')
def taken(letters, tmp_path_factory):
    bag = tmp_path_factory.mktemp('report') / 'GShape_1'
    recordings.write(bag, letters[0], 'panda_link0', NS)
    return bag


def test_a_page_shows_where_takes_like_these_would_be(letters, taken, tmp_path):
    several, single = tmp_path / 'several.json', tmp_path / 'single.json'
    Skill.learn(letters[:3], 40).save(several)
    Skill.learn(letters[0], 40).save(single)
    page = tmp_path / 'take.html'
    pages.write_report(taken, page, skill=several)
    body = page.read_text().split('</script>', 1)[1]
    assert '95 % of takes' in body and '95 % of takes, most' in body
    with pytest.raises(DataError, match='single take'):
        pages.write_report(taken, page, skill=single)


def test_a_page_loads_nothing_from_elsewhere(taken, tmp_path):
    path = tmp_path / 'new' / 'take.html'
    assert pages.write_report(taken, path) == 'a demonstration'
    text = path.read_text()
    body = text.split('</script>', 1)[1]
    assert 'panda_link0' in body and 'position, orientation, stiffness' in body
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', body)
    with pytest.raises(DataError, match='no such bag'):
        pages.write_report(tmp_path / 'none', path)
    (tmp_path / 'file').write_text('')
    with pytest.raises(DataError, match='cannot write the report'):
        pages.write_report(taken, tmp_path / 'file' / 'page.html')


def test_the_page_of_a_run_tells_what_happened_and_which_limits_were_active():
    run = recorded_run()
    events, active = runs.events(run), runs.limited_times(run)
    figure = report_figures.run_over_time(run, runs.tracking(run), events, active)
    axes = [axis for name, axis in figure.to_dict()['layout'].items() if name.startswith('xaxis')]
    assert len(axes) == 7  # six panels, and the limits
    assert all(axis['title']['text'] == 'time [s]' and axis['showticklabels'] for axis in axes)
    numbers = [note.text for note in figure.layout.annotations]
    assert numbers == [str(k) for k in range(1, len(events) + 1)]
    bars, = (trace for trace in figure.data if trace.line.width == 7)
    np.testing.assert_allclose(bars.x, [0.1, 0.15, np.nan, 0.9, 1.0, np.nan])
    assert set(bars.y) == {'joint_position'}


@pytest.mark.skipif(CHROMIUM is None, reason='no Chromium')
@pytest.mark.parametrize('what', ['run', pytest.param('demonstration', marks=pytest.mark.long)])
def test_a_browser_opens_it_without_an_error(taken, tmp_path, monkeypatch, what):
    path, picture = tmp_path / 'page.html', tmp_path / 'page.png'
    if what == 'run':
        monkeypatch.setattr(runs, 'topics', lambda _: [
            (runs.REFERENCE_TOPIC, '', 1), (runs.STATE_TOPIC, '', 1)])
        monkeypatch.setattr(pages.runs, 'read', lambda _: recorded_run())
    pages.write_report(taken, path)
    done = subprocess.run([CHROMIUM, *FLAGS, f'--user-data-dir={tmp_path / "profile"}',
                           f'--screenshot={picture}', '--window-size=1100,2400',
                           path.as_uri()], capture_output=True, text=True, timeout=120)
    console = [line for line in done.stderr.splitlines() if 'CONSOLE' in line]
    wrong = [line for line in console if not line.split('CONSOLE')[0].endswith('INFO:')
             or re.search('Uncaught|rror:|ailed', line)]
    assert wrong == []
    from PIL import Image
    drawn = np.asarray(Image.open(picture).convert('RGB')).reshape(-1, 3)
    assert len(np.unique(drawn, axis=0)) > 200  # the figures are there

"""A report is one page that a browser opens without the network and without an error."""
import re
import shutil
import subprocess

import numpy as np
import pytest

from gdmp_ros.control.limits import LIMITS
from gdmp_ros.errors import DataError
from gdmp_ros.data import lasa
from gdmp_ros.data import recordings
from gdmp_ros.data import runs
from gdmp_ros.data.runs import Run
from gdmp_ros.view import report_figures as drawing
from gdmp_ros.data import run_analysis as findings
from gdmp_ros.view import report_page as page

NS = 1_000_000_000
CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which(
    'google-chrome')
FLAGS = ('--headless=new', '--no-sandbox', '--disable-gpu', '--use-angle=swiftshader',
         '--enable-unsafe-swiftshader', '--disable-background-networking', '--disable-sync',
         '--disable-component-update', '--disable-quic', '--no-first-run',
         '--enable-logging=stderr', '--virtual-time-budget=20000')


def made_run(count=2000):
    """A run with a bow, a stop of the references for 300 ms, and a limit that bites twice."""
    t = 1e-3 * np.arange(count)
    poses = np.column_stack([0.4 + 0.1 * np.minimum(t, 1.0), 0.1 * np.sin(t), 0.5 + 0 * t,
                             1 + 0 * t, 0 * t, 0 * t, 0 * t])
    stamps = 1_700_000_000 * NS + (t * NS).round().astype(np.int64)
    kept = (t < 1.2) | (t >= 1.5)
    limited = np.zeros((count, len(LIMITS)))
    limited[100:150, 2], limited[900:1000, 2] = 0.4, 1.5
    stiffness = np.tile(np.diag([400.0] * 3 + [30.0] * 3).reshape(-1), (count, 1))
    sequences = 7_000_000 + np.arange(count, dtype=np.uint64)
    away = poses.copy()
    away[:, 2] += 0.003
    return Run(reference_stamps=stamps[kept], published=stamps[kept] + 50_000,
               sequences=sequences[kept], references=poses[kept],
               reference_stiffness=stiffness[kept], moving=(t < 1.0)[kept], state_stamps=stamps,
               applied=sequences[np.where(kept, np.arange(count), 1199)], poses=away,
               stiffness=stiffness, twists=np.zeros((count, 6)), joints=np.zeros((count, 7)),
               velocities=np.zeros((count, 7)), torques=np.zeros((count, 7)),
               tank=5.0 - 0.5 * t, limited=limited)


def test_a_run_is_summed_up_and_its_events_are_told_in_order():
    run = made_run()
    rows = dict(findings.figures(run, findings.tracking(run)))
    assert rows['references lost'] == '300' == str(runs.lost(run))
    assert rows['lateness p50, p99, max'] == '50, 50, 50 µs'
    states, away, turned = findings.tracking(run)
    assert len(states) == 2000 and away[0] == pytest.approx(0.003) and not turned.any()
    told = findings.events(run)
    assert [event.time for event in told] == sorted(event.time for event in told)
    text = '\n'.join(f'{event.time:.2f} {event.what}' for event in told)
    assert '0.00 the reference begins to move' in text and 'it stands, after 1.00 s' in text
    assert '1.20 no reference for 301 ms' in text
    name = LIMITS[2].name
    assert f'0.10 limited: {name} by up to 0.4' in text
    assert f'0.90 limited: {name} by up to 1.5' in text


def test_ellipsoids_are_long_where_the_arm_is_stiff():
    positions = np.column_stack([np.linspace(0, 1, 50), np.zeros(50), np.zeros(50)])
    matrices = np.tile(np.diag([100.0, 800.0, 200.0]), (50, 1, 1))
    drawn = drawing._ellipsoids(positions, matrices, 'stiffness')
    assert np.nanmax(drawn.y) == pytest.approx(drawing.ELLIPSOID_M)
    assert np.nanmax(drawn.z) == pytest.approx(drawing.ELLIPSOID_M / 4)


@pytest.fixture(scope='module')
def taken(tmp_path_factory):
    bag = tmp_path_factory.mktemp('report') / 'GShape_1'
    recordings.write(bag, lasa.robot_demonstrations('GShape')[0], 'panda_link0', NS)
    return bag


def test_a_page_needs_nothing_else(taken, tmp_path):
    path = tmp_path / 'new' / 'take.html'
    assert page.write(taken, path) == 'a demonstration'
    text = path.read_text()
    body = text.split('</script>', 1)[1]
    assert 'panda_link0' in body and 'position, orientation, stiffness' in body
    assert not re.findall(r'(?:src|href)="(?!data:|#)[^"]*"', body)
    with pytest.raises(DataError, match='no such bag'):
        page.write(tmp_path / 'none', path)
    (tmp_path / 'file').write_text('')
    with pytest.raises(DataError, match='cannot write the report'):
        page.write(taken, tmp_path / 'file' / 'page.html')


@pytest.mark.skipif(CHROMIUM is None, reason='no Chromium')
@pytest.mark.parametrize('what', ['run', 'demonstration'])
def test_a_browser_opens_it_without_an_error(taken, tmp_path, monkeypatch, what):
    path, picture = tmp_path / 'page.html', tmp_path / 'page.png'
    if what == 'run':
        monkeypatch.setattr(page.bags, 'topics', lambda _: [
            (runs.REFERENCE_TOPIC, '', 1), (runs.STATE_TOPIC, '', 1)])
        monkeypatch.setattr(page.runs, 'read', lambda _: made_run())
    page.write(taken, path)
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


def test_runs_of_several_robots_are_told_apart_by_their_namespace(tmp_path):
    from gdmp_msgs.msg import Reference, RobotState
    from rclpy.serialization import serialize_message

    from gdmp_ros.data.bags import BagWriter, REFERENCE
    from gdmp_ros.ros.recorder.record import definition
    with BagWriter(tmp_path / 'both', 'mcap') as bag:
        for i in range(20):
            for robot, x in (('left', 0.3), ('right', 0.6)):
                for name, kind, message in (
                        (f'/{robot}/trajectory_server/reference', REFERENCE, Reference()),
                        (f'/{robot}/panda_sim/state', runs.STATE, RobotState())):
                    message.header.stamp.nanosec, message.sequence = i * 1_000_000, i + 1
                    message.pose.position.x, message.pose.orientation.w = x, 1.0
                    if kind == runs.STATE:
                        message.position = message.velocity = message.torque = [0.0] * 7
                    bag.raw(name, kind, 1 + i * 1_000_000, serialize_message(message),
                            *definition(kind))
    for robot, x in (('left', 0.3), ('/right', 0.6)):
        run = runs.read(tmp_path / 'both', robot)
        assert len(run.references) == 20 and (run.poses[:, 0] == x).all()
    with pytest.raises(DataError, match='expected one topic with references, the bag has '
                                        '/left/trajectory_server/reference, /right/'):
        runs.read(tmp_path / 'both')
    with pytest.raises(DataError, match='with references in middle, the bag has none'):
        runs.read(tmp_path / 'both', 'middle')

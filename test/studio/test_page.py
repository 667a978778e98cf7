"""The studio in a real browser."""
import re
import signal
import socket

import numpy as np
import pytest

from gdmp_ros import Skill
from gdmp_ros.data import lasa, recordings
from test.commands import gdmp
from test.motions import circles
from test.studio.browser import needs_browser, opened_browser, Page, StudioProcess

pytestmark = needs_browser


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp('studio')
    shown = lasa.robot_demonstrations('GShape')
    for number, take in enumerate(shown[:3], 1):
        recordings.write(path / 'takes' / f'take_{number:03d}', take, 'panda_link0',
                         recordings.EPOCH_NS)
    Skill.learn(shown[:3], 30).save(path / 'skill.json')
    Skill.learn(shown[3], 30).save(path / 'other.json')
    return path


@pytest.fixture(scope='module')
def browser():
    with opened_browser() as found:
        yield found


@pytest.fixture(scope='module')
def studio(folder):
    process = StudioProcess('skill.json', 'other.json', 'takes', cwd=folder)
    yield process
    _, code = process.end()
    assert code == 0


@pytest.fixture
def page(browser, studio):
    made = Page(browser, studio.address)
    yield made
    made.check_clean()
    made.page.close()


def ends_at(text):
    """Where the path ends, in the text of the page [m]."""
    found = re.search(r'ends at (-?[\d.]+), (-?[\d.]+), (-?[\d.]+) m', text)
    return np.array([float(one) for one in found.groups()]) if found else None


def test_dragging_the_goal_changes_the_path(page, folder):
    skill = Skill.load(folder / 'skill.json')
    before = page.wait('the path', lambda text: ends_at(text))
    np.testing.assert_allclose(before, skill.goal[:3], atol=1e-3)
    # The arrow of the tool's z axis, which points down.
    grip = skill.goal[:3] - [0.0, 0.0, 0.1]
    page.drag(grip, grip - [0.0, 0.0, 0.08])
    after = page.wait('a changed path', lambda text: (
        found if (found := ends_at(text)) is not None and abs(found - before).max() > 0.02
        else None))
    np.testing.assert_allclose(after[:2], before[:2], atol=0.02)
    assert -0.12 < after[2] - before[2] < -0.04
    page.wait_text('changed, not saved')
    page.click('undo all changes')
    page.wait('the learned path', lambda text: abs(ends_at(text) - before).max() < 1e-6)


def test_a_via_point_is_added_and_the_skill_saved(page, folder):
    page.page.get_by_text('via points', exact=True).first.click()
    page.click('add a via point')
    page.wait_text('1 via point ')
    page.type('skill_changed.json', 'bent.json')
    page.click('save the skill')
    page.wait_text('bent.json')
    assert Skill.load(folder / 'bent.json').via == (0.5,)
    page.click('save the skill')
    page.wait_text('exists already; tick')
    page.type('bent.json', 'bent.txt')
    page.click('save the skill')
    page.wait_text('expected the name of a file that ends in .json')
    page.click('undo all changes')


def test_a_skill_is_run_and_its_goal_switched_in_motion(page):
    page.tab('run')
    # A slow motion: a busy machine may show the page once in several seconds.
    page.set_slider('tempo', 0.2)
    page.click('start')
    page.wait('a slow motion', lambda text: re.search(r'moving, .*tempo 0.20', text))
    page.tab('skill')
    field = page.page.get_by_label('goal [m]').first
    field.fill('0.45')
    field.press('Enter')
    page.tab('run')
    page.wait('a tool on its way', lambda text: 'moving' in text)
    page.set_slider('tempo', 1.0)
    reached = page.wait('the goal', lambda text: re.search(
        r'holding.*?tool at (0\.4[45]\d), .*?([\d.]+) mm and', text, re.S), 60.0)
    assert abs(float(reached.group(1)) - 0.45) < 0.004 and float(reached.group(2)) < 4.0
    # A robot at rest does not move when another skill is chosen, or a goal is changed.
    page.tab('skill')
    page.choose('skill', 'other')
    page.wait('the other skill', lambda text: ends_at(text)[0] != 0.45)
    page.choose('skill', 'skill')
    page.click('undo all changes')
    page.page.wait_for_timeout(1000)
    page.tab('run')
    still = page.wait('the robot', lambda text: re.search(r'tool at (0\.\d+),', text))
    assert abs(float(still.group(1)) - float(reached.group(1))) < 1.5e-3


def test_a_push_corrects_the_skill_when_asked(page, folder):
    page.tab('run')
    page.page.get_by_text('correct by hand', exact=True).first.click()
    page.click('move to the home posture')  # away from the handle of the goal
    page.wait('the way home', lambda text: 'arm: move' in text)
    page.wait('the arm at home', lambda text: 'arm: hold' in text, 60.0)
    page.tick('push the arm while it moves')
    # So slow that a busy browser can grasp the moving handle.
    page.set_slider('tempo', 0.05)
    page.click('start')
    place = page.wait('the moving arm', lambda text: re.search(
        r'moving, .*?tempo 0.05.*?tool at (-?[\d.]+), (-?[\d.]+), (-?[\d.]+) m', text, re.S))
    # The handle follows the tool until it is grasped.
    tool = np.array([float(one) for one in place.groups()])
    grip = tool - [0.0, 0.0, 0.12]
    page.drag(grip, grip + [0.0, 0.0, 0.15], steps=15, held=3.0)
    page.set_slider('tempo', 1.0)
    page.wait('the end', lambda text: 'holding' in text, 60.0)
    page.click('correct by the last motion')
    found = page.wait('the correction', lambda text: re.search(r'position at \d+ %: (\d+) mm',
                                                              text))
    assert int(found.group(1)) > 10
    page.tab('skill')
    page.wait_text('changed, not saved')
    page.type('skill_changed.json', 'pushed.json')
    page.click('save the skill')
    page.wait_text('pushed.json')
    before, after = Skill.load(folder / 'skill.json'), Skill.load(folder / 'pushed.json')
    moved = (after.reproduce(0.05).points - before.reproduce(0.05).points)[:, :3]
    assert 0.01 < np.linalg.norm(moved, axis=1).max() < 0.2
    page.tab('run')
    page.click('undo the correction')
    page.tab('skill')
    page.wait('the learned path', lambda text: 'changed, not saved' in text)
    page.click('undo all changes')
    page.tab('run')
    page.tick('push the arm while it moves')


def test_a_take_is_taught_dropped_and_learned(page, folder):
    page.tab('teach')
    page.tick('guide the arm by hand')
    page.tab('run')
    place = page.wait('the guided arm', lambda text: re.search(
        r'guided.*?tool at (-?[\d.]+), (-?[\d.]+), (-?[\d.]+) m', text, re.S))
    tool = np.array([float(one) for one in place.groups()])
    page.tab('teach')
    page.click('record a take')
    page.wait_text('recording, ')
    grip = tool - [0.0, 0.0, 0.12]
    page.drag(grip, grip - [0.0, 0.0, 0.1], steps=30)
    page.page.wait_for_timeout(1000)
    page.click('keep the take')
    page.wait_text('take_004', timeout=60.0)
    taught = recordings.read(folder / 'takes' / 'take_004').demonstration
    moved = taught.points[-1, :3] - taught.points[0, :3]
    assert moved[2] < -0.04 and np.abs(moved[:2]).max() < 0.03
    page.choose('take', 'take_004')
    page.click('drop the take')
    page.wait_text('moved to')
    assert (folder / 'takes' / 'dropped' / 'take_004').is_dir()
    page.click('learn')
    page.wait_text('learned from 3 takes', timeout=90.0)


def test_two_browsers_and_a_lost_connection(browser, studio, page):
    second = Page(browser, studio.address)
    field = second.page.get_by_label('goal [m]').first
    field.fill('0.5')
    field.press('Enter')
    page.wait('the change of the other browser', lambda text: abs(ends_at(text)[0] - 0.5) < 1e-6)
    second.page.close()  # as a laptop that is closed
    page.click('undo all changes')
    page.wait('the learned path', lambda text: abs(ends_at(text)[0] - 0.5) > 1e-3)


def test_compared_skills_and_the_time_slider(page):
    page.page.get_by_label('other', exact=True).click()
    page.tick('play')
    page.wait('the time', lambda text: re.search(r'[1-9][.\d]* s: 0\.\d', text))
    page.tick('play')


def test_other_pages_may_not_connect(studio):
    host, port = re.match(r'http://([\d.]+):(\d+)', studio.address).groups()

    def asked(*headers):
        with socket.create_connection((host, int(port)), 5.0) as connection:
            connection.sendall('\r\n'.join(['GET / HTTP/1.1', *headers, '', '']).encode())
            return connection.recv(200).split(b'\r\n')[0]
    assert b'200' in asked(f'Host: {host}:{port}')
    assert b'403' in asked('Host: attacker.example')
    upgrade = ('Connection: Upgrade', 'Upgrade: websocket', 'Sec-WebSocket-Version: 13',
               'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==')
    assert b'403' in asked(f'Host: {host}:{port}', 'Origin: http://attacker.example', *upgrade)
    assert b'101' in asked(f'Host: {host}:{port}', f'Origin: http://{host}:{port}', *upgrade)


def test_elsewhere_a_token_is_asked_for(folder, browser):
    process = StudioProcess('skill.json', '--host', '0.0.0.0', cwd=folder)
    try:
        address = process.address.replace('0.0.0.0', '127.0.0.1')
        page = browser.new_page()
        answer = page.goto(address.partition('?')[0])
        assert answer.status == 401 and 'token' in page.inner_text('body')
        page.close()
        known = Page(browser, address)
        known.wait('the path', lambda text: ends_at(text) is not None)
        assert '?token' not in known.page.url
        known.page.close()
    finally:
        process.end()


def test_a_taken_port_is_refused_before_work(folder, studio):
    port = studio.address.rstrip('/').rpartition(':')[2]
    done = gdmp('studio', 'skill.json', '--port', port, '--no-browser', cwd=folder)
    assert done.returncode == 1 and '--port' in done.stderr and 'Traceback' not in done.stderr


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_it_ends_at_once_and_leaves_nothing(folder, number):
    process = StudioProcess('skill.json', cwd=folder)
    process.process.send_signal(number)
    rest, _ = process.process.communicate(timeout=10)
    assert process.process.returncode == 0 and 'Traceback' not in rest
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind(('127.0.0.1', int(process.address.rstrip('/').rpartition(':')[2])))


def test_a_sequence_is_run_from_the_page(browser, folder):
    home = Skill.load(folder / 'skill.json').start[:7]
    Skill.learn_rhythmic(circles(home, 0.04, 4.3)).save(folder / 'wipe.json')
    (folder / 'clean.yaml').write_text(
        'steps: [{skill: skill.json}, {skill: wipe.json, until: enough}, {skill: other.json}]')
    process = StudioProcess('clean.yaml', cwd=folder)
    try:
        page = Page(browser, process.address)
        page.page.get_by_text('sequence', exact=True).first.click()
        page.wait_text('wipe: until enough')
        page.click('start the sequence')
        page.page.get_by_text('run', exact=True).first.click()
        page.wait_text('step 2 of 3, wipe')
        page.wait_text('amplitude 1.00')
        page.page.get_by_text('sequence', exact=True).first.click()
        page.click('send the signal')
        page.page.get_by_text('run', exact=True).first.click()
        page.wait_text('step 3 of 3, other')
        page.check_clean()
        page.page.close()
    finally:
        process.end()

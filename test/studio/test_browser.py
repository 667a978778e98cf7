"""The studio in a real browser, and as a process: three tests of each."""
from io import BytesIO
import re
import signal
import socket

import numpy as np
from PIL import Image
import pytest

from gdmp_ros import Skill
from gdmp_ros.studio.scene import colour
from test.commands import gdmp
from test.studio.browser import needs_browser, Page, StudioProcess
from test.studio.test_page import ends_at


@pytest.fixture(scope='module')
def studio(folder):
    process = StudioProcess('skill.json', 'other.json', 'takes', cwd=folder)
    yield process
    rest, code = process.end()
    assert code == 0 and 'Traceback' not in rest


@pytest.fixture(scope='module')
def page(browser, studio, folder):
    """One page for all: the first picture takes ten seconds without a graphics card."""
    made = Page(browser, studio.address, Skill.load(folder / 'skill.json'))
    yield made
    made.check_clean()


@needs_browser
def test_the_mouse_drags_the_goal(page, folder):
    skill = Skill.load(folder / 'skill.json')
    before = page.wait('the path', ends_at)
    np.testing.assert_allclose(before, skill.goal[:3], atol=1e-3)
    # The arrow of the tool's z axis, which points down.
    grip = skill.goal[:3] - [0.0, 0.0, 0.1]
    page.drag(grip, grip - [0.0, 0.0, 0.08])
    after = page.wait('a changed path', lambda text: (
        found if abs((found := ends_at(text)) - before).max() > 0.02 else None))
    np.testing.assert_allclose(after[:2], before[:2], atol=0.02)
    assert -0.12 < after[2] - before[2] < -0.04
    page.click('undo all changes')
    page.wait('the learned path', lambda text: abs(ends_at(text) - before).max() < 1e-6)


@needs_browser
def test_a_skill_is_run_and_its_goal_typed_in_motion(page):
    page.tab('run')
    # A slow motion: a busy machine may show the page once in several seconds.
    page.set_slider('tempo', 0.2)
    page.click('start')
    page.wait('a slow motion', lambda text: re.search(r'moving, .*tempo 0.20', text))
    page.tab('skill')
    page.enter('goal [m]', '0.45')
    page.tab('run')
    page.set_slider('tempo', 2.0)
    reached = page.wait('the goal', lambda text: re.search(
        r'holding.*?tool at (0\.4[45]\d), .*?([\d.]+) mm and', text, re.S))
    assert abs(float(reached.group(1)) - 0.45) < 0.004 and float(reached.group(2)) < 4.0
    page.tab('skill')


@needs_browser
def test_another_browser_changes_the_same_skill_and_goes(page, browser, studio, folder):
    other = Page(browser, studio.address, Skill.load(folder / 'skill.json'))
    other.enter('goal [m]', '0.5')
    page.wait('the change of the other browser', lambda text: abs(ends_at(text)[0] - 0.5) < 1e-6)
    other.check_clean()
    other.page.close()  # as a laptop that is closed
    page.click('undo all changes')
    page.wait('the learned path', lambda text: abs(ends_at(text)[0] - 0.5) > 1e-3)


@needs_browser
def test_curves_are_drawn(page):
    page.page.get_by_text('curves', exact=True).first.click()
    page.step(10)

    def drawn():
        picture = np.asarray(Image.open(BytesIO(
            page.page.locator('.uplot').first.screenshot())).convert('RGB'), int)
        return all((np.abs(picture - colour(k)).max(axis=2) < 40).sum() > 40 for k in range(3))
    page.wait_for('three curves', drawn)


def asked(address, *headers):
    """First line of the answer of a server, and all of it."""
    host, port, path = re.match(r'http://([^:/]+):(\d+)(/.*)', address).groups()
    with socket.create_connection((host, int(port)), 5.0) as connection:
        connection.sendall('\r\n'.join([f'GET {path} HTTP/1.1', *headers, '', '']).encode())
        answer = connection.recv(2000)
    return answer.split(b'\r\n')[0], answer.decode(errors='replace')


def test_elsewhere_a_token_is_asked_for(folder):
    process = StudioProcess('skill.json', '--address', '0.0.0.0', cwd=folder)
    try:
        address = re.sub('//[^:]+:', '//127.0.0.1:', process.address)
        plain, token = address.split('?token=')
        host = 'Host: ' + re.search(r'//([^/]+)/', address).group(1)
        first, answer = asked(plain, host)
        assert b'401' in first and 'token' in answer
        assert b'401' in asked(f'{plain}?token=wrong', host)[0]
        first, answer = asked(address, host)
        cookie = re.search(r'(?i)set-cookie: ([^;]+)', answer).group(1)
        assert token not in asked(plain, host, f'Cookie: {cookie}')[1]
        assert b'200' in asked(plain, host, f'Cookie: {cookie}')[0]
    finally:
        rest, code = process.end(signal.SIGTERM)
    assert code == 0 and 'Traceback' not in rest
    with socket.socket() as again:  # nothing is left behind
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind(('127.0.0.1', int(re.search(r':(\d+)/', process.address).group(1))))


def test_other_pages_may_not_connect(studio):
    address = studio.address
    host = re.search(r'//([^/]+)/', address).group(1)
    assert b'200' in asked(address, f'Host: {host}')[0]
    assert b'403' in asked(address, 'Host: attacker.example')[0]
    upgrade = ('Connection: Upgrade', 'Upgrade: websocket', 'Sec-WebSocket-Version: 13',
               'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==')
    assert b'403' in asked(address, f'Host: {host}', 'Origin: http://attacker.example',
                           *upgrade)[0]
    assert b'101' in asked(address, f'Host: {host}', f'Origin: http://{host}', *upgrade)[0]


def test_a_taken_port_is_refused_before_work(folder, studio):
    port = studio.address.rstrip('/').rpartition(':')[2]
    done = gdmp('studio', folder / 'skill.json', '--port', port, '--no-browser')
    assert done.returncode == 1 and '--port' in done.stderr and 'Traceback' not in done.stderr

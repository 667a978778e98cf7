"""A real browser that opens the studio, and a studio as a process."""
from contextlib import contextmanager
import re
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest

from gdmp_ros.studio.first_view import first_view
from gdmp_ros.studio.motion import of_skill
from gdmp_ros.studio.scene import COVERED, PHONE
from test.commands import GDMP

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which(
    'google-chrome')
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason='no Chromium for the tests of the studio: apt install chromium')
#: Software rendering; nothing is asked of the network.
FLAGS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
         '--ignore-gpu-blocklist', '--disable-background-networking',
         '--disable-component-update', '--disable-sync', '--no-first-run']
#: Each pixel is drawn by software; but a handle must be large enough for the mouse.
SIZE = {'width': 1100, 'height': 700}
#: Time of the page between two pictures [ms].
STEP_MS = 50


class StudioProcess:
    """``gdmp studio`` with these arguments, until `end`."""

    def __init__(self, *words, cwd):
        self.process = subprocess.Popen(
            [*GDMP, 'studio', '--no-browser', *map(str, words)], cwd=cwd, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.lines = []
        for line in self.process.stdout:
            self.lines.append(line)
            found = re.search(r'studio: (http://\S+)', line)
            if found is not None:
                self.address = found.group(1)
                return
        raise AssertionError(''.join(self.lines))

    def end(self, number=signal.SIGINT):
        """Ctrl-C; returns what it printed after the address, and its exit code."""
        self.process.send_signal(number)
        rest, _ = self.process.communicate(timeout=60)
        return rest, self.process.returncode


@contextmanager
def opened_browser():
    """Chromium."""
    from playwright.sync_api import sync_playwright
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            yield browser
        finally:
            browser.close()


class Page:
    """
    The studio in a browser: texts, buttons, handles; collects errors and foreign requests.

    The page's own time passes only in `step`: it draws when a test looks at it.

    :ivar covered: share of the height of the picture that the panel covers
    """

    def __init__(self, browser, address, skill, size=SIZE):
        """:param skill: that is looked at first"""
        self.page = browser.new_page(viewport=size)
        self.errors, self.foreign = [], []
        self.page.on('console', self._on_console)
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))
        self.page.on('request', self._on_request)
        self.page.clock.install(time=0)
        self.page.clock.pause_at(1000)
        self.page.goto(address)
        self.wait('the panel', lambda text: 'skill' in text)
        # A note that the browser draws by software, in front of the panel.
        self.page.locator('#webgl-software-rendering button').click()
        self.step()
        # As the page does (`gdmp_ros.studio.scene.Scene`).
        canvas = self.page.locator('canvas').first.bounding_box()
        self.covered = COVERED if canvas['width'] < PHONE else 0.0
        self.view = first_view(of_skill(skill).poses[:, :3], canvas['width'] / canvas['height'],
                               self.covered)

    def _on_console(self, message):
        if message.type == 'error':
            self.errors.append(message.text)

    def _on_request(self, request):
        if not re.match(r'(https?|ws)://(127\.0\.0\.1|localhost)[:/]|data:|blob:', request.url):
            self.foreign.append(request.url)

    def text(self):
        """All text of the page."""
        return self.page.inner_text('body')

    def step(self, count=1):
        """Let the page's time pass."""
        for _ in range(count):
            self.page.clock.fast_forward(STEP_MS)  # which draws once

    def wait(self, what, until, timeout=60.0):
        """Wait until a condition of the page's text holds; returns what it returned."""
        return self.wait_for(what, lambda: until(self.text()), timeout)

    def wait_for(self, what, until, timeout=60.0):
        """Wait until a condition holds; returns what it returned."""
        ends = time.monotonic() + timeout
        while True:
            self.step()
            found = until()
            if found is not None and found is not False:
                return found
            assert time.monotonic() < ends, f'{what}:\n{self.text()}'
            time.sleep(0.1)

    def tab(self, name):
        self.page.get_by_role('tab', name=name, exact=True).click()
        self.step()

    def click(self, button):
        self.page.get_by_role('button', name=button, exact=True).click()

    def set_slider(self, label, value):
        """Type a value into the field of a slider."""
        field = self.page.locator(f'xpath=//*[text()="{label}"]/following::input[@type="text"][1]')
        field.fill(str(value))
        field.press('Enter')

    def enter(self, label, value):
        """Type into the first field with a label."""
        field = self.page.get_by_label(label).first
        field.fill(value)
        field.press('Enter')

    def pixel(self, position):
        """Where a point of space is drawn, with the first view [pixels]."""
        box = self.page.locator('canvas').first.bounding_box()
        (right, up), = self.view.projected(np.atleast_2d(position))
        half = 0.5 * box['height']
        return box['x'] + 0.5 * box['width'] + half * right, box['y'] + half - half * up

    def drag(self, first, last, steps=10):
        """Drag from a point of space to another one with the mouse."""
        mouse = self.page.mouse
        begin, end = np.array(self.pixel(first)), np.array(self.pixel(last))
        mouse.move(*begin)
        self.step(4)  # the handle notices the mouse
        mouse.down()
        for step in range(1, steps + 1):
            mouse.move(*(begin + (end - begin) * step / steps))
            self.step()
        mouse.up()

    def check_clean(self):
        assert self.errors == [] and self.foreign == []

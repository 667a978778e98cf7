"""A real browser that opens the studio, and a studio as a process."""
from contextlib import contextmanager
import re
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest

from gdmp_ros.studio.scene import EYE, FIELD_OF_VIEW, LOOKED_AT
from test.commands import GDMP

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser') or shutil.which(
    'google-chrome')
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason='no Chromium for the tests of the studio: apt install chromium')
#: Software rendering; nothing is asked of the network.
FLAGS = ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
         '--ignore-gpu-blocklist', '--disable-background-networking',
         '--disable-component-update', '--disable-sync', '--no-first-run']
SIZE = {'width': 1200, 'height': 800}


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
            if found is not None and found is not False:
                self.address = found.group(1)
                return
        raise AssertionError(''.join(self.lines))

    def end(self):
        """Ctrl-C; returns what it printed after the address, and its exit code."""
        self.process.send_signal(signal.SIGINT)
        rest, _ = self.process.communicate(timeout=30)
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
    """The studio in a browser: texts, buttons, handles; collects errors and foreign requests."""

    def __init__(self, browser, address):
        self.page = browser.new_page(viewport=SIZE)
        self.errors, self.foreign, self.frames = [], [], 0
        self.page.on('console', self._on_console)
        self.page.on('pageerror', lambda error: self.errors.append(str(error)))
        self.page.on('request', self._on_request)
        self.page.goto(address)
        self.wait_text('skill', exact=True)

    def _on_console(self, message):
        if message.type == 'error':
            self.errors.append(message.text)

    def _on_request(self, request):
        if not re.match(r'(https?|ws)://(127\.0\.0\.1|localhost)[:/]|data:|blob:', request.url):
            self.foreign.append(request.url)

    def text(self):
        """All text of the page."""
        return self.page.inner_text('body')

    def wait_text(self, text, exact=False, timeout=30.0):
        """Wait until the page shows a text."""
        self.page.get_by_text(text, exact=exact).first.wait_for(timeout=1e3 * timeout)

    def wait(self, what, until, timeout=30.0):
        """Wait until a condition of the page's text holds; returns what it returned."""
        ends = time.monotonic() + timeout
        while True:
            text = self.text()
            found = until(text)
            if found is not None and found is not False:
                return found
            assert time.monotonic() < ends, f'{what}:\n{text}'
            self.page.wait_for_timeout(50)

    def tab(self, name):
        self.page.get_by_role('tab', name=name, exact=True).click()

    def click(self, button):
        self.page.get_by_role('button', name=button, exact=True).click()

    def type(self, before, after):
        """Replace the text of the field that has a text."""
        self.page.locator(f'input[value="{before}"]').fill(after)
        self.page.keyboard.press('Enter')

    def choose(self, label, option):
        """Choose an option of a list."""
        self.page.get_by_label(label, exact=True).first.click()
        self.page.get_by_role('option', name=option, exact=True).click()

    def set_slider(self, label, value):
        """Type a value into the field of a slider."""
        field = self.page.locator(f'xpath=//*[text()="{label}"]/following::input[@type="text"][1]')
        field.fill(str(value))
        field.press('Enter')

    def tick(self, box):
        """Tick or untick a box."""
        self.page.get_by_label(box, exact=True).click()

    def pixel(self, position):
        """Where a point of space is drawn, with the first view [pixels]."""
        eye = np.array(EYE)
        forward = np.array(LOOKED_AT) - eye
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        up = np.cross(right, forward)
        away = np.asarray(position) - eye
        scale = 0.5 * SIZE['height'] / np.tan(0.5 * np.radians(FIELD_OF_VIEW)) / (away @ forward)
        return (0.5 * SIZE['width'] + scale * (away @ right),
                0.5 * SIZE['height'] - scale * (away @ up))

    def drag(self, first, last, steps=10, held=0.0):
        """Drag from a point of space to another one with the mouse, and hold it there [s]."""
        mouse = self.page.mouse
        begin, end = np.array(self.pixel(first)), np.array(self.pixel(last))
        mouse.move(*begin)
        self.page.wait_for_timeout(1000)  # the handle notices the mouse
        mouse.down()
        for step in range(1, steps + 1):
            mouse.move(*(begin + (end - begin) * step / steps))
            self.page.wait_for_timeout(60)
        self.page.wait_for_timeout(1e3 * held)
        mouse.up()

    def check_clean(self):
        assert self.errors == [] and self.foreign == []

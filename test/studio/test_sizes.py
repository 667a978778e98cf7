"""The studio on a large screen, on a small one and on a phone, in a real browser."""
from io import BytesIO
import re

import numpy as np
from PIL import Image
import pytest

from gdmp_ros import Skill
from gdmp_ros.studio.motion import of_skill
from test.studio.browser import needs_browser, Page, StudioProcess
from test.studio.test_first_view import SKILLS
from test.studio.test_page import ends_at

pytestmark = [needs_browser, pytest.mark.long]

SIZES = {'large': (1440, 900), 'small': (1024, 700), 'phone': (390, 844)}
#: Another skill for each page, and each size with one of them at least.
SHOWN = dict(zip(SKILLS, ['large', 'small', 'phone', 'large', 'small']))


class Sized(Page):
    """A page of one of `SIZES`, and what is drawn in the part that the panel leaves free."""

    def __init__(self, browser, address, skill, size):
        width, height = SIZES[size]
        super().__init__(browser, address, skill, {'width': width, 'height': height})
        self.wait('the path', lambda text: 'ends at' in text or None)
        canvas = self.page.locator('canvas').first.bounding_box()
        self.width = int(canvas['width'])
        self.height = int(canvas['height'] * (1.0 - self.covered))

    def picture(self):
        """What is drawn in the free part of the page."""
        self.step(3)
        drawn = np.asarray(Image.open(BytesIO(self.page.screenshot())).convert('RGB'), int)
        return drawn[:self.height, :self.width]

    def settled(self):
        """What is drawn in the free part of the page as soon as it stays the same."""
        last = [self.picture()]

        def same():
            last.append(self.picture())
            return last[-1] if (last[-1] == last[-2]).all() else None
        return self.wait_for('a picture that stays', same)

    def pixels_of(self, layer):
        """Rows and columns of the pixels that a layer of the view draws."""
        box = self.page.get_by_label(f'show {layer}')
        box.scroll_into_view_if_needed()

        def switched(before):
            box.click()
            self.wait_for(f'another picture: {layer}', lambda: (self.picture() != before).any())
            return self.settled()

        def drawn():
            shown = self.settled()
            hidden = switched(shown)
            # A mesh that arrives meanwhile would count as a part of the layer.
            same = (switched(hidden) == shown).all()
            return np.abs(hidden - shown).max(axis=2) > 30 if same else None
        return np.nonzero(self.wait_for(f'{layer} as the only change', drawn))

    def open_folder(self, name):
        """Open a folder of the panel."""
        self.page.get_by_text(name, exact=True).first.click()
        self.step(10)

    def write(self, label, text):
        """Write into the field of a text."""
        self.page.locator(f'xpath=//label[text()="{label}"]/following::input[1]').fill(text)
        self.step(4)  # the page sends a text after a while, a click at once

    def inside(self, locator):
        """Whether a part of the panel is as wide as the page allows."""
        locator.scroll_into_view_if_needed()
        box = locator.bounding_box()
        page = self.page.viewport_size
        return box['x'] >= 0 and box['x'] + box['width'] <= page['width'] and box['height'] > 10


@pytest.mark.parametrize('name', SHOWN)
def test_at_first_sight_the_path_fills_half_of_the_picture_beside_goal_and_arm(
        name, browser, tmp_path):
    skill = SKILLS[name]()
    skill.save(tmp_path / 'skill.json')
    process = StudioProcess('skill.json', cwd=tmp_path)
    try:
        page = Sized(browser, process.address, skill, SHOWN[name])
        page.open_folder('view')
        rows, columns = page.pixels_of('path')
        smaller = min(page.width, page.height)
        assert max(np.ptp(rows), np.ptp(columns)) >= 0.5 * smaller
        # Where the view says that it is; the balls of start and goal cover its ends.
        x, y = np.transpose([page.pixel(point) for point in of_skill(skill).poses[:, :3]])
        np.testing.assert_allclose([columns.min(), columns.max(), rows.min(), rows.max()],
                                   [x.min(), x.max(), y.min(), y.max()], atol=25.0)
        x, y = page.pixel(skill.goal[:3])
        assert 0 <= x <= page.width and 0 <= y <= page.height
        rows, columns = page.pixels_of('arm')
        assert len(rows) > 0.005 * page.width * page.height
        page.check_clean()
        page.page.close()
    finally:
        process.end()


@pytest.fixture(scope='module')
def studio(folder):
    process = StudioProcess('skill.json', 'takes', cwd=folder)
    yield process
    rest, code = process.end()
    assert code == 0 and 'Traceback' not in rest


@pytest.fixture(scope='module', params=SIZES)
def page(request, browser, studio, folder):
    made = Sized(browser, studio.address, Skill.load(folder / 'skill.json'), request.param)
    yield made
    made.check_clean()
    made.page.close()


def test_every_button_is_on_the_page(page):
    for tab in ('run', 'teach', 'surroundings', 'skill'):
        page.tab(tab)
        page.step(4)
        buttons = [button for button in page.page.get_by_role('button').all()
                   if button.is_visible() and button.inner_text()]
        assert len(buttons) >= 2
        for button in buttons:
            assert page.inside(button), (tab, button.inner_text())


def test_a_change_is_undone_and_made_again(page):
    page.tab('skill')
    learned = page.wait('the path', ends_at)[0]
    page.enter('goal [m]', '0.44')
    page.wait('the change', lambda text: abs(ends_at(text)[0] - 0.44) < 1e-6)
    page.click('undo')
    page.wait('the learned path', lambda text: abs(ends_at(text)[0] - learned) < 1e-6)
    page.click('redo')
    page.wait('the change again', lambda text: abs(ends_at(text)[0] - 0.44) < 1e-6)
    page.click('undo all changes')
    page.wait('the learned path', lambda text: abs(ends_at(text)[0] - learned) < 1e-6)


def test_what_is_refused_is_told_and_goes(page):
    page.tab('skill')
    page.write('open', 'missing.json')
    page.click('open the file')
    page.wait('the refusal', lambda text: 'missing.json' in text)
    page.wait('its end', lambda text: 'missing.json' not in text)


def test_a_file_is_opened(page):
    page.tab('skill')
    page.write('open', 'other.json')
    page.click('open the file')
    page.wait('what was opened', lambda text: 'opened' in text)
    page.wait('its path', lambda text: 'ends at' in text)


def test_a_file_is_sent_from_the_browser(page, folder, tmp_path):
    page.tab('skill')
    sent = tmp_path / f'sent_{page.width}.json'
    sent.write_bytes((folder / 'other.json').read_bytes())
    page.page.locator('input[type=file]').set_input_files(sent)
    # A second skill is offered for comparison.
    page.wait('what was sent', lambda text: sent.stem in text.splitlines())
    assert Skill.load(folder / sent.name).goal.tolist() == Skill.load(sent).goal.tolist()


def test_layers_are_shown_and_hidden(page):
    page.tab('run')
    page.open_folder('view')
    for layer in ('stiffness', 'path', 'arm'):
        assert len(page.pixels_of(layer)[0]) > 100, layer


def test_the_panel_folds_and_shows_what_is_behind_it(page):
    title = page.page.get_by_text(re.compile('^gdmp studio')).first
    page.page.get_by_role('tab', name='skill', exact=True).wait_for()
    (title if page.covered else page.page.locator('.tabler-icon-chevrons-right').first).click()
    page.wait_for('a folded panel', lambda: not page.page.get_by_role(
        'tab', name='skill', exact=True).is_visible())

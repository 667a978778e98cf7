"""What a user does on the page of the studio, and what it does with the robot; in lockstep."""
import re

import numpy as np
import pytest

from gdmp_ros import Demonstration, Skill
from gdmp_ros.data import bags, recordings
from gdmp_ros.scene import read_scene
from gdmp_ros.studio.scene import LAYERS
from test.data.test_objects import transform
from test.motions import circles
from test.studio.lockstep import opened_page


@pytest.fixture
def page(folder, monkeypatch):
    monkeypatch.chdir(folder)
    with opened_page(folder, 'skill.json', 'other.json', 'takes') as made:
        yield made


def ends_at(text):
    """Where the path ends, in the text of the page [m]."""
    found = re.search(r'ends at (-?[\d.]+), (-?[\d.]+), (-?[\d.]+) m', text)
    return np.array([float(one) for one in found.groups()]) if found else None


def test_dragging_the_goal_and_the_start_changes_the_path(page, folder):
    skill = Skill.load(folder / 'skill.json')
    np.testing.assert_allclose(ends_at(page.text()), skill.goal[:3], atol=1e-3)
    page.drag('goal', [0.0, 0.0, -0.08])
    np.testing.assert_allclose(ends_at(page.text()), skill.goal[:3] - [0.0, 0.0, 0.08], atol=1e-3)
    page.wait_text('changed, not saved')
    page.drag('start', [0.0, 0.05, 0.0])
    np.testing.assert_allclose(page.part('start [m]').value, skill.start[:3] + [0.0, 0.05, 0.0],
                               atol=1e-9)
    page.enter('duration [s]', 5.0)
    page.wait_text('in 5.00 s')
    page.click('undo all changes')
    np.testing.assert_allclose(ends_at(page.text()), skill.goal[:3], atol=1e-3)
    assert 'changed, not saved' not in page.text()


def test_a_path_that_the_arm_cannot_follow_is_said(page):
    page.wait_text('the arm can follow the whole path')
    page.enter('goal [m]', (1.2, 0.0, 0.4))
    page.wait('the verdict', lambda text: re.search(r'\*\*.*(reach|far)', text))


def test_a_via_point_is_added_moved_and_the_skill_saved_and_exported(page, folder):
    page.click('add a via point')
    page.wait_text('1 via point')
    page.drag('via 50 %', [0.0, 0.0, 0.02])
    page.enter('skill_changed.json', 'bent.json')
    page.click('save the skill')
    page.wait_text('bent.json')
    bent, before = Skill.load(folder / 'bent.json'), Skill.load(folder / 'skill.json')
    assert bent.via == (0.5,)
    rise = (bent.rollout(duration=1.0).advance(0.5).point
            - before.rollout(duration=1.0).advance(0.5).point)
    np.testing.assert_allclose(rise[:3], [0.0, 0.0, 0.02], atol=1e-4)
    page.click('save the skill')
    page.wait_text('exists already; tick')
    page.enter('replace an existing file', True)
    page.click('save the skill')
    page.click('export the motion as CSV')
    page.wait_text('exported')
    assert (folder / 'bent.csv').read_text().startswith('time')
    page.enter('bent.json', 'bent.txt')
    page.click('save the skill')
    page.wait_text('expected the name of a file that ends in .json')
    page.click('remove the via points')
    assert 'via point' not in page.wait('the path', lambda text: text).split('functions')[1][:20]


def test_a_skill_is_run_and_its_goal_switched_in_motion(page):
    page.enter('tempo', 0.4)
    page.click('start')
    page.wait('a slow motion', lambda text: re.search(r'moving\*\*, .*tempo 0.40', text))
    x, y, z = page.part('goal [m]').value
    page.enter('goal [m]', (0.45, y, z))
    assert 'moving' in page.text()
    page.enter('tempo', 1.0)
    reached = page.wait('the goal', lambda text: re.search(
        r'holding.*?tool at (0\.4[45]\d), .*?([\d.]+) mm and', text, re.S), 60.0)
    assert abs(float(reached.group(1)) - 0.45) < 0.004 and float(reached.group(2)) < 4.0
    # A robot at rest does not move when another skill is chosen, or a goal is changed.
    page.enter('skill', 'other')
    assert ends_at(page.text())[0] != 0.45
    page.enter('skill', 'skill')
    page.click('undo all changes')
    page.spend(1.0)
    still = re.search(r'tool at (0\.\d+),', page.text())
    assert abs(float(still.group(1)) - float(reached.group(1))) < 1.5e-3


@pytest.fixture
def among(folder, monkeypatch):
    """The page with a skill that begins at a box and ends at a hole."""
    monkeypatch.chdir(folder)
    letter = Skill.load(folder / 'other.json')
    path = letter.reproduce(0.02)
    Skill.learn(Demonstration(path.times, path.points, letter.manifold, frames={
        'box': letter.start[:7], 'hole': letter.goal[:7]}), start_frame='box',
        goal_frame='hole').save(folder / 'among.json')
    with opened_page(folder, 'among.json', 'skill.json') as made:
        yield made


def test_objects_are_dragged_and_the_path_goes_with_them(among, folder):
    skill = Skill.load(folder / 'among.json')
    scene = among.studio.scene
    assert set(scene.marks()) == {'object box', 'object hole'}
    away = np.array([0.0, 0.04, 0.03])
    among.drag('object hole', away)
    np.testing.assert_allclose(ends_at(among.text()), skill.goal[:3] + away, atol=1e-3)
    among.drag('object box', [0.02, 0.0, 0.0])
    np.testing.assert_allclose(among.part('start [m]').value, skill.start[:3] + [0.02, 0.0, 0.0],
                               atol=1e-4)
    among.enter('among_changed.json', 'moved.json')
    among.click('save the skill')
    among.wait_text('moved.json')
    moved = Skill.load(folder / 'moved.json')
    np.testing.assert_allclose(moved.views[-1].pose[:3] - skill.views[-1].pose[:3], away,
                               atol=1e-6)
    among.click('add a via point')
    among.wait_text('refused: via points')
    among.click('undo all changes')
    np.testing.assert_allclose(ends_at(among.text()), skill.goal[:3], atol=1e-3)
    among.enter('skill', 'skill')
    assert set(scene.marks()) == {'goal', 'start'}


def test_an_object_that_is_dragged_in_motion_takes_the_motion_with_it(among, folder):
    skill, away = Skill.load(folder / 'among.json'), np.array([0.0, 0.05, 0.03])
    among.enter('tempo', 0.4)
    among.click('start')
    among.wait_text('**moving**')
    among.spend(1.0)
    among.drag('object hole', away)
    among.wait_text('**holding**')
    among.spend(0.5)
    reached = among.studio.robot.view().pose[:3]
    np.testing.assert_allclose(reached, skill.goal[:3] + away, atol=5e-3)


def test_a_motion_is_paused_and_stopped(page):
    page.click('start')
    page.wait('a motion', lambda text: 'moving' in text)
    page.enter('paused', True)
    page.wait('a pause', lambda text: '**paused**' in text)
    page.spend(0.5)
    assert '**paused**' in page.text()
    page.enter('paused', False)
    page.wait('a motion', lambda text: 'moving' in text)
    page.click('stop')
    page.wait('the end', lambda text: '**holding**' in text)


def test_a_push_corrects_the_skill_when_asked(page, folder):
    page.click('correct by the last motion')
    page.wait_text('has not been executed')
    page.enter('push the arm while it moves', True)
    page.enter('tempo', 0.5)
    page.click('start')
    page.wait('the moving arm', lambda text: re.search(r'moving\*\*, .*?tempo 0.50', text))
    page.spend(0.5)
    page.drag('push', [0.0, 0.0, 0.15], steps=15, held=0.3)
    page.enter('tempo', 1.0)
    page.wait('the end', lambda text: '**holding**' in text, 60.0)
    page.click('correct by the last motion')
    found = page.wait('the correction', lambda text: re.search(r'position at \d+ %: (\d+) mm',
                                                              text))
    assert int(found.group(1)) > 10
    page.wait_text('changed, not saved')
    page.enter('skill_changed.json', 'pushed.json')
    page.click('save the skill')
    page.wait_text('pushed.json')
    before, after = Skill.load(folder / 'skill.json'), Skill.load(folder / 'pushed.json')
    moved = (after.reproduce(0.05).points - before.reproduce(0.05).points)[:, :3]
    assert 0.01 < np.linalg.norm(moved, axis=1).max() < 0.2
    page.click('undo the correction')
    page.click('undo all changes')
    assert 'changed, not saved' not in page.text()


def test_a_take_is_taught_dropped_and_learned(page, folder):
    page.click('record a take')
    page.wait_text('nothing guides the arm')
    page.enter('guide the arm by hand', True)
    page.wait('the guided arm', lambda text: 'arm: guided' in text)
    page.click('record a take')
    page.wait_text('recording, ')
    page.drag('hand', [0.0, 0.0, -0.1], steps=30, held=1.0)
    page.click('keep the take')
    page.wait_text('take_004')
    taught = recordings.read(folder / 'takes' / 'take_004').demonstration
    moved = taught.points[-1, :3] - taught.points[0, :3]
    assert moved[2] < -0.06 and np.abs(moved[:2]).max() < 0.03
    page.enter('guide the arm by hand', False)
    page.enter('take', 'take_004')
    page.click('drop the take')
    page.wait_text('moved to')
    assert (folder / 'takes' / 'dropped' / 'take_004').is_dir()
    page.enter('take_003', False)
    page.enter('automatic number of functions', False)
    page.enter('functions', 25)
    page.click('learn')
    page.wait_text('learned from 2 takes: 25 functions')
    assert page.part('skill').value == 'learned from 2 takes'


def test_learning_that_is_refused_is_said(page):
    for name in ('take_001', 'take_002', 'take_003'):
        page.enter(name, False)
    page.click('learn')
    page.wait_text('refused: no take is used')


def test_takes_are_learned_between_objects_that_their_transforms_know(folder, monkeypatch):
    monkeypatch.chdir(folder)
    times = np.linspace(0.0, 3.0, 150)
    with bags.BagWriter(folder / 'between') as writer:
        for name, x in (('box', 0.4), ('hole', 0.5)):
            transform(writer, '/tf_static', name, 10 ** 9, [x, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0])
        for time in times:
            way = 0.5 - 0.5 * np.cos(np.pi * time / 3.0)
            writer.pose('/pose', 10 ** 9 + round(1e9 * time), [
                0.4 + 0.1 * way, 0.2 * way, 0.3, 0.0, 1.0, 0.0, 0.0], 'base')
    with opened_page(folder, 'between') as page:
        page.enter('objects', 'box cup')
        page.click('learn')
        page.wait_text('no transforms lead from cup to base')
        page.enter('objects', 'box hole')
        page.click('learn')
        page.wait_text('learned from 1 take')
        assert set(page.studio.scene.marks()) == {'object box', 'object hole'}


def test_compared_skills_and_the_time_slider(page):
    page.enter('other', True)
    page.wait('the other path', lambda _: page.studio.scene.lines('skill other') or None)
    page.enter('time [%]', 40.0)
    page.wait('the time', lambda text: re.search(r'[1-9][.\d]* s: 0\.\d', text))
    page.enter('play', True)
    page.spend(0.5)
    page.enter('play', False)
    assert page.part('time [%]').value > 41.0
    page.enter('other', False)
    page.wait('no other path', lambda _: not page.studio.scene.lines('skill other'))


def test_a_sequence_is_run_from_the_page(folder, monkeypatch):
    monkeypatch.chdir(folder)
    home = Skill.load(folder / 'skill.json').start[:7]
    Skill.learn_rhythmic(circles(home, 0.04, 4.3)).save(folder / 'wipe.json')
    (folder / 'clean.yaml').write_text(
        'steps: [{skill: skill.json}, {skill: wipe.json, until: enough}, {hold: 1}]')
    with opened_page(folder, 'clean.yaml') as page:
        page.wait_text('wipe: until enough')
        scene = page.studio.scene
        assert set(scene.lines('step ')) == {'step 1', 'step 2'}
        still = scene._lines['step 2'].colors[0, 0].tolist()
        page.enter('first step', 2)
        page.click('start the sequence')
        page.wait_text('step 2 of 3, wipe')
        assert scene._lines['step 2'].colors[0, 0].tolist() != still
        page.wait_text('amplitude 1.00')
        page.enter('amplitude', 0.5)
        page.wait_text('amplitude 0.50')
        page.click('send the signal')
        page.wait_text('step 3 of 3')
        page.wait('the end', lambda text: '**holding**' in text)
        page.wait('no step', lambda text: 'step 3 of 3' not in text)
        page.click('start the sequence')
        page.wait_text('step 2 of 3, wipe')
        page.click('stop the sequence')
        page.wait('the end', lambda text: '**holding**' in text)


def test_what_the_user_enters_counts_although_the_studio_writes_to_the_field(page):
    box = page.part('guide the arm by hand')
    box.value = True
    page.use(box)
    box.value = False  # as when a view of the robot, not guided yet, is shown first
    page.wait('the guided arm', lambda text: 'arm: guided' in text)
    assert box.value


def test_what_the_studio_writes_is_no_wish_of_a_user(page):
    page.part('paused').value = True
    page.spend(0.2)
    page.click('start')
    page.wait('a motion', lambda text: 'moving' in text)


def test_a_browser_that_is_closed_lets_go(page):
    page.enter('guide the arm by hand', True)
    page.wait('the guided arm', lambda text: 'arm: guided' in text)
    page.move('hand', page.position('hand') + [0.0, 0.0, 1.0], 'update')
    page.spend(0.1)
    assert page.position('hand')[2] - page.studio.view.pose[2] > 0.9
    page.close()
    page.spend(0.1)  # the handle is where the tool is again
    np.testing.assert_allclose(page.position('hand'), page.studio.view.pose[:3], atol=0.05)


def test_changes_are_undone_and_made_again_one_by_one(page, folder):
    skill = Skill.load(folder / 'skill.json')
    page.click('undo')
    page.wait_text('refused: there is nothing to undo')
    page.drag('goal', [0.0, 0.0, -0.08])
    page.enter('duration [s]', 5.0)
    page.click('add a via point')
    page.wait_text('1 via point')
    page.click('undo')
    assert '1 via point' not in page.text().split('functions')[1][:20]
    page.click('undo')
    page.wait_text(f'in {skill.duration:.2f} s')
    # The whole drag is one change.
    page.click('undo')
    np.testing.assert_allclose(ends_at(page.text()), skill.goal[:3], atol=1e-3)
    assert 'changed, not saved' not in page.text()
    page.click('redo')
    np.testing.assert_allclose(ends_at(page.text()), skill.goal[:3] - [0.0, 0.0, 0.08], atol=1e-3)
    page.click('redo')
    page.wait_text('in 5.00 s')
    page.enter('duration [s]', 4.0)
    page.click('redo')
    page.wait_text('refused: there is nothing to redo')
    page.click('undo all changes')
    page.click('undo')
    page.wait_text('in 4.00 s')


def test_only_what_is_selected_has_a_handle(page):
    scene = page.studio.scene
    assert set(scene.marks()) == {'goal', 'start'} and set(scene.handles('')) == {'goal'}
    page.enter('move with the handle', 'start')
    assert set(scene.handles('')) == {'start'}
    page.click('add a via point')
    assert set(scene.marks()) == {'goal', 'start', 'via 50 %'}
    page.click_at('via 50 %')
    assert set(scene.handles('')) == {'via 50 %'}
    assert page.part('move with the handle').value == 'via 50 %'
    page.click('remove the via points')
    assert set(scene.handles('')) == {'goal'} and page.part(
        'move with the handle').value == 'goal'


def test_the_path_before_a_correction_is_seen_beside_that_after_it_and_the_takes():
    before, after, takes = (np.array(LAYERS[name][0]) for name in ('before', 'path', 'takes'))
    for one, other in ((before, after), (before, takes), (after, takes)):
        assert np.abs(one - other).max() > 100


def test_layers_are_hidden_and_shown(page):
    scene = page.studio.scene
    page.wait('the ellipsoids', lambda _: 'stiffness' in scene._batches or None)
    assert not scene._batches['stiffness'].visible and scene._lines['path'].visible
    page.enter('show stiffness', True)
    page.enter('show path', False)
    assert scene._batches['stiffness'].visible and not scene._lines['path'].visible
    # What is drawn again stays as it was chosen.
    page.drag('goal', [0.0, 0.0, -0.03])
    assert not scene._lines['path'].visible
    page.enter('show arm', False)
    page.spend(0.2)
    assert not scene.arm._root.visible


def test_files_are_opened_from_the_page(folder, monkeypatch, tmp_path):
    monkeypatch.chdir(folder)
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path))
    with opened_page(folder) as page:
        page.wait_text('No skill yet')
        page.click('save the skill')
        page.wait_text('refused: there is no skill yet')
        page.click('open the file')
        page.wait_text('expected the name of a file')
        field = next(part for part in page._parts() if getattr(part, 'label', None) == 'open')
        (folder / 'again.yaml').write_text('steps: [{skill: other.json}, {hold: 1}]')
        assert 'start the sequence' not in page.text()
        for name, said in (('nothing.json', 'no such file'), ('skill.json', 'skill skill'),
                           ('takes', 'recordings'), ('again.yaml', 'sequence again.yaml')):
            field.value = name
            page.click('open the file')
            page.wait_text(said)
        assert page.part('skill').value == 'skill' and len(page.studio.bench.takes) == 3
        page.wait_text('take_001')
        page.wait_text('other')
        page.click('start the sequence')
        page.wait_text('step 1 of 2')
        page.click('stop the sequence')
        page.wait('the end', lambda text: '**holding**' in text)
    with opened_page(folder) as page:
        recent = page.part('recent')
        assert recent.options == ('choose one', *(
            str(folder / name) for name in ('again.yaml', 'takes', 'skill.json')))
        page.enter('recent', str(folder / 'skill.json'))
        page.wait_text('skill skill')
        assert recent.value == 'choose one' and recent.options[1] == str(folder / 'skill.json')


def test_obstacles_are_added_dragged_and_the_motion_is_led_around(page, folder):
    skill = Skill.load(folder / 'skill.json')
    path = skill.reproduce(0.02).points[:, :3]
    middle = path[np.argmax(np.linalg.norm(path - path[0], axis=1))]
    page.click('remove it')
    page.wait_text('refused: nothing is chosen')
    page.enter('kind', 'sphere')
    page.click('add something')
    page.wait('the handle', lambda _: page.studio.scene.handles('thing ') or None)
    page.enter('size [m]', (0.02, 0.0, 0.0))
    assert page.studio.bench.scene['sphere 1'].size == (0.02,)
    page.drag('thing sphere 1', middle - page.position('thing sphere 1'))
    found = page.wait('the way', lambda text: re.search(
        r'led around sphere 1: ([\d.]+) times as long|blocked by sphere 1', text))
    assert found
    page.spend(0.1)
    known = page.studio.robot._loop.controller.scene
    np.testing.assert_allclose(known['sphere 1'].pose[:3], middle, atol=1e-6)
    page.enter('scene.yaml', 'around.yaml')
    page.click('save the scene')
    page.wait_text('around.yaml')
    page.click('save the scene')
    page.wait_text('around.yaml: exists already; tick')
    back = read_scene(folder / 'around.yaml')
    np.testing.assert_allclose(back['sphere 1'].pose[:3], middle, atol=1e-5)
    page.click('remove it')
    page.wait('nothing', lambda text: 'led around sphere' not in text and 'blocked by' not in text)
    assert page.studio.scene.volumes() == []
    with opened_page(folder, 'skill.json', 'around.yaml') as other:
        other.wait('the scene', lambda _: other.studio.scene.volumes() or None)
        assert other.part('thing').value == 'sphere 1'

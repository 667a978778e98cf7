"""What the studio works on, without a page."""
import numpy as np
import pytest

from gdmp_ros import Skill, SpecialOrthogonal
from gdmp_ros.data.skills import LearningSettings
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.studio import workbench
from gdmp_ros.studio.commands import Jobs
from gdmp_ros.studio.motion import of_skill, SAMPLES, tube
from gdmp_ros.studio.recent import RecentFiles
from gdmp_ros.studio.workbench import opened, Workbench
from test.motions import motion


@pytest.fixture
def bench(folder):
    return opened([folder / 'skill.json', folder / 'takes'])


def test_a_changed_goal_and_via_points_are_in_the_saved_skill(bench, tmp_path):
    goal = bench.skill.goal[:7].copy()
    goal[1] += 0.05
    bench.changes.goal = goal
    position = bench.edited().rollout(duration=1.0).advance(0.5).point[:3] + [0.0, 0.0, 0.03]
    bench.add_via(0.5, position)
    bench.changes.duration = 3.0
    bench.save(tmp_path / 'new' / 'changed.json')
    saved = Skill.load(tmp_path / 'new' / 'changed.json')
    shown = of_skill(saved)
    assert saved.duration == 3.0 and len(shown.times) == SAMPLES
    np.testing.assert_allclose(shown.poses[-1, :3], goal[:3], atol=1e-3)
    passed = saved.rollout(duration=1.0).advance(0.5).point[:3]
    np.testing.assert_allclose(passed, position, atol=1e-5)


def test_a_via_point_that_cannot_be_met_changes_nothing(bench):
    bench.add_via(0.5, bench.skill.rollout(duration=1.0).advance(0.5).point[:3])
    with pytest.raises(GdmpError, match='via point'):
        bench.add_via(1.5, np.zeros(3))
    assert list(bench.changes.via) == [0.5]


def test_the_tube_follows_the_changes(bench):
    poses, covariances = tube(bench.edited())
    assert np.linalg.eigvalsh(covariances[len(poses) // 2, :3, :3]).min() > 0.0
    bench.changes.goal = np.concatenate([bench.skill.goal[:3] + 0.05, bench.skill.goal[3:7]])
    # At its nominal end the motion still moves to a goal that was changed.
    np.testing.assert_allclose(tube(bench.edited())[0][-1, :3], bench.changes.goal[:3], atol=5e-3)


def test_takes_that_are_used_are_learned_and_one_is_dropped(bench, folder):
    assert len(bench.comparison()) == 3
    bench.takes[0].used = False
    name = bench.take_in(bench.learning(LearningSettings(n_basis=20, stiffness='none'))())
    assert bench.chosen == name == 'learned from 2 takes'
    assert bench.skill.n_basis == 20
    moved = bench.drop(bench.takes[0])
    assert moved.parent.name == 'dropped' and len(bench.takes) == 2
    for take in bench.takes:
        take.used = False
    with pytest.raises(DataError, match='no take is used'):
        bench.learning(LearningSettings())
    moved.rename(folder / 'takes' / moved.name)


def test_what_cannot_be_opened_is_named(tmp_path):
    Skill.learn(motion(SpecialOrthogonal(3), np.random.default_rng(0)), 10).save(
        tmp_path / 'rotation.json')
    with pytest.raises(DataError, match='a pose reference needs'):
        opened([tmp_path / 'rotation.json'])
    with pytest.raises(DataError, match='nowhere'):
        opened([tmp_path / 'nowhere'])
    (tmp_path / 'empty').mkdir()
    with pytest.raises(DataError, match='neither a rosbag2 folder'):
        opened([tmp_path / 'empty'])


def test_what_a_browser_sends_is_kept_or_refused_as_a_whole(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bench, sent = Workbench(), (folder / 'skill.json').read_bytes()
    assert bench.receive('/somewhere/else/mine.json', sent) == ('skill mine', 'mine')
    assert (tmp_path / 'mine.json').read_bytes() == sent and bench.recent.paths()[0] == (
        tmp_path / 'mine.json')
    with pytest.raises(DataError, match='mine.json: exists already'):
        bench.receive('mine.json', sent)
    with pytest.raises(DataError, match='not a skill'):
        bench.receive('mine.json', b'{}', replace_file=True)
    assert (tmp_path / 'mine.json').read_bytes() == sent
    for name, content, reason in (('empty.json', b'', 'the file is empty'),
                                  ('..', b'{}', 'expected the name of a file'),
                                  ('bad.json', b'\xff', 'bad.json'),
                                  ('other.txt', b'words', 'other.txt: no row of numbers')):
        with pytest.raises(DataError, match=reason):
            bench.receive(name, content, replace_file=name == '..')
    assert [path.name for path in tmp_path.iterdir()] == ['mine.json']


def test_a_damaged_list_of_recent_files_is_an_empty_one(tmp_path):
    recent = RecentFiles(tmp_path / 'state' / 'recent.json')
    assert recent.paths() == []
    for number in range(15):
        (tmp_path / f'{number}.json').touch()
        recent.add(tmp_path / f'{number}.json')
    recent.add(tmp_path / '5.json')
    (tmp_path / '14.json').unlink()
    assert [path.stem for path in recent.paths()] == [
        '5', '13', '12', '11', '10', '9', '8', '7', '6', '4', '3']
    for damaged in ('{', '5', '[1, null]'):
        (tmp_path / 'state' / 'recent.json').write_text(damaged)
        assert recent.paths() == []


def test_of_the_same_kind_only_the_newest_job_waits():
    jobs, done = Jobs(), []
    for number in range(5):
        jobs.put(lambda number=number: done.append(number), 'drag')
    jobs.put(lambda: done.append('button'))
    jobs.put(lambda: done.append('drag again'), 'drag')
    while (work := jobs.take()) is not None:
        work()
    assert done == ['button', 'drag again']


def test_a_skill_with_many_functions_is_changed_too(letters):
    skill = Skill.learn(letters[0], 500)
    bench = Workbench()
    bench.add('many', skill)
    bench.changes.goal = np.concatenate([skill.goal[:3] + 0.03, skill.goal[3:7]])
    bench.add_via(0.5, bench.edited().rollout(duration=1.0).advance(0.5).point[:3] + 0.01)
    np.testing.assert_allclose(of_skill(bench.edited()).poses[-1, :3], bench.changes.goal[:3],
                               atol=1e-3)


def test_a_bag_that_would_take_minutes_is_refused_with_the_reason(folder, monkeypatch):
    monkeypatch.setattr(workbench, 'LARGEST', 100)
    with pytest.raises(DataError, match='the studio opens bags with at most 100 on a topic'):
        opened([folder / 'takes'])

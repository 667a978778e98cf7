"""A folder with skills and takes for the studio, and a browser."""
import pytest

from gdmp_ros.data import recordings
from gdmp_ros.dmp.skill import Skill
from test.studio.browser import opened_browser


@pytest.fixture(scope='session', autouse=True)
def own_state(tmp_path_factory):
    """What the studio remembers is not that of the user who runs the tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_STATE_HOME', str(tmp_path_factory.mktemp('state')))
        yield


@pytest.fixture(scope='module')
def folder(letters, tmp_path_factory):
    path = tmp_path_factory.mktemp('studio')
    for number, take in enumerate(letters[:3], 1):
        recordings.write(path / 'takes' / f'take_{number:03d}', take, 'panda_link0',
                         recordings.EPOCH_NS)
    Skill.learn(letters[:3], 30).save(path / 'skill.json')
    Skill.learn(letters[3], 30).save(path / 'other.json')
    return path


@pytest.fixture(scope='module')
def browser():
    with opened_browser() as found:
        yield found

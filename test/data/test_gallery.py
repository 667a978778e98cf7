"""The skills of the gallery reach their goals; skill files match their schema."""
import json
from pathlib import Path
import re

import jsonschema
import pytest

from gdmp_ros import Skill
from gdmp_ros.data import gallery
from test.commands import gdmp
from test.pictures import drawn

DOCS = Path(__file__).parents[2] / 'docs'
SCHEMA = json.loads((DOCS / 'skill.schema.json').read_text())


def make(folder, *names):
    done = gdmp('examples', 'skills', *names, '-o', 'here', cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / 'here'


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    return make(tmp_path_factory.mktemp('gallery'), 'pick-and-place', 'screw', 'polish')


def check(folder, names):
    """Every skill has a file that matches the schema, a picture and an entry, and moves."""
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    page = (folder / 'index.md').read_text()
    for name in names:
        jsonschema.validate(json.loads((folder / f'{name}.json').read_text()), SCHEMA)
        skill = Skill.load(folder / f'{name}.json')
        rollout = skill.rollout()
        rollout.advance(1.3 * skill.duration)
        assert rollout.finished and rollout.flags == set(), name
        assert drawn(folder / f'{name}.png') > 0.01
        assert f']({name}.png)' in page


def test_skills_are_written_with_pictures_and_a_page(made):
    check(made, ['pick-and-place', 'screw', 'polish'])
    screw = Skill.load(made / 'screw.json')
    assert len(screw.segments) > 1  # it turns further than half a turn
    assert Skill.load(made / 'polish.json').manifold.names[-1] == 'stiffness'


@pytest.mark.long
def test_all_skills_are_those_of_the_documentation(tmp_path):
    made = make(tmp_path)
    check(made, gallery.EXAMPLES)
    kept = (DOCS / 'gallery' / 'index.md').read_text()
    assert kept == (made / 'index.md').read_text(), 'gdmp examples skills -o docs/gallery'
    for picture in re.findall(r'\]\(([\w-]+\.png)\)', kept):
        assert (DOCS / 'gallery' / picture).is_file()


@pytest.mark.parametrize('field, value', [
    ('format', 'other'), ('version', 9), ('manifold', {'kind': 'product', 'factors': []}),
    ('connection', 'flat'), ('gains', {'alpha_z': 1.0}), ('duration', -1.0), ('steps', 0),
    ('weights', [[0.0]]), ('provenance', 'me'), ('variation', 'much')])
def test_schema_and_reader_refuse_the_same(made, tmp_path, field, value):
    document = json.loads((made / 'pick-and-place.json').read_text())
    document[field] = value
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(document, SCHEMA)
    path = tmp_path / 'bad.json'
    path.write_text(json.dumps(document))
    with pytest.raises(ValueError, match='bad.json'):
        Skill.load(path)


def test_unknown_names_are_refused_with_the_known_ones(tmp_path):
    done = gdmp('examples', 'skills', 'oven', '-o', 'x', cwd=tmp_path)
    assert done.returncode == 1 and 'expected one of letter-G' in done.stderr
    assert not (tmp_path / 'x').exists()

"""Scenes: their files, and what is refused."""
import numpy as np
import pytest

from gdmp_ros import DataError
from gdmp_ros.scene import read_scene, Scene, Volume
from gdmp_ros.scene.distance import distances
from gdmp_ros.scene.volume import CAPACITY

HERE = np.array([0.5, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0])
FILE = """\
margin: 0.03
volumes:
  - {name: post, kind: capsule, size: [0.03, 0.4], position: [0.5, 0.1, 0.2]}
  - {name: crate, kind: box, size: [0.2, 0.3, 0.1], pose: [0.4, -0.3, 0.05, 1, 0, 0, 0],
     margin: 0.01, allowed: [hand]}
  - {name: table, kind: plane, position: [0, 0, -0.01]}
"""


def test_a_file_is_read(tmp_path):
    path = tmp_path / 'scene.yaml'
    path.write_text(FILE)
    scene = read_scene(path)
    assert scene.names == ('post', 'crate', 'table') and scene.margin == 0.03
    rows = scene.packed({'hand': 4, 'link7': 2})
    assert rows[:, 17].tolist() == [0.03, 0.01, 0.03] and rows[:, 18].tolist() == [0.0, 4.0, 0.0]
    # The table is solid below its plane.
    np.testing.assert_allclose(
        distances(rows[2], np.array([[3.0, 2.0, 0.09], [0.0, 0.0, -0.06]])), [0.1, -0.05])
    scene.remove('post')
    assert len(scene) == 2 and 'post' not in scene
    with pytest.raises(DataError, match="no volume 'post'"):
        scene['post']
    with pytest.raises(DataError, match="no link 'hand'; it has link1"):
        scene.packed({'link1': 1})


@pytest.mark.parametrize(('text', 'reason'), [
    ('volumes: 3', 'not a scene file'), ('{', 'not a scene file'), ('volumes: [3]', 'volume 1'),
    ('volumes: [{kind: cone, size: [1], position: [0, 0, 0]}]', "kind is 'cone'"),
    ('volumes: [{kind: box, size: [1, 1], position: [0, 0, 0]}]', 'a box has 3'),
    ('volumes: [{kind: sphere, size: [-1], position: [0, 0, 0]}]', 'expected above 0'),
    ('volumes: [{kind: sphere, size: [.nan], position: [0, 0, 0]}]', 'expected above 0'),
    ('volumes: [{kind: sphere, size: [1], position: [0, 0]}]', 'pose is'),
    ('volumes: [{kind: sphere, size: [1], pose: [0, 0, 0, 2, 0, 0, 0]}]', 'length 2'),
    ('volumes: [{kind: sphere, size: [1]}]', 'expected pose'),
    ('volumes: [{kind: sphere, size: [1], position: [0, 0, 0], colour: red}]', "'colour'"),
    ('volumes: [{kind: plane, position: [0, 0, 0], allowed: hand}]', 'names of links'),
    ('{margin: -1, volumes: []}', 'margin is -1'),
    ('{margin: wide, volumes: []}', "got 'wide'"),
    ('volumes: [{name: a, kind: plane, position: [0, 0, 0]}, '
     '{name: a, kind: plane, position: [0, 0, 0]}]', 'two volumes')])
def test_a_file_that_is_wrong_is_refused_with_the_place(text, reason, tmp_path):
    path = tmp_path / 'scene.yaml'
    path.write_text(text)
    with pytest.raises(DataError, match=reason) as refused:
        read_scene(path)
    assert str(path) in str(refused.value)


def test_there_are_not_too_many():
    scene = Scene([Volume(f'{k}', 'sphere', (0.1,), HERE) for k in range(CAPACITY)])
    scene.put(Volume('3', 'box', (0.1, 0.1, 0.1), HERE))
    with pytest.raises(DataError, match='64 volumes already'):
        scene.put(Volume('more', 'sphere', (0.1,), HERE))

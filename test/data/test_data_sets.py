"""Riemannian LASA and 2D-Letters."""
import numpy as np
import pytest
from scipy.io import savemat

from gdmp_ros.cli.main import main
from gdmp_ros.data import lasa, public_sets
from gdmp_ros.errors import DataError
from gdmp_ros.manifolds import SymmetricPositiveDefinite
from test.commands import experiments


def letter(folder, name, shapes=((2, 200), (2, 200)), still=False):
    """Write a file with the fields of the public data set."""
    rng = np.random.default_rng(3)
    demos = np.empty((1, len(shapes)), dtype=object)
    for i, shape in enumerate(shapes):
        t = np.linspace(0.0, 1.0, shape[1])
        pos = 6.0 * np.array([np.cos(3.0 * t + 0.1 * rng.random()), np.sin(3.0 * t)])[:shape[0]]
        if still:
            pos[:] = 1.0
        one = np.empty((1, 1), dtype=[(n, object) for n in ('pos', 'vel', 'acc')])
        one[0, 0] = (pos, pos, pos)
        demos[0, i] = one
    path = folder / f'{name}.mat'
    savemat(str(path), {'demos': demos}, do_compression=True)
    return path


@pytest.mark.parametrize('mapping, shape', [('R2', (2,)), ('S2', (3,)), ('S3', (4,)),
                                            ('SO3', (3, 3)), ('SPD2', (2, 2))])
def test_all_demonstrations_of_a_class_are_on_the_manifold(mapping, shape):
    shown = lasa.data_set('Sine', mapping)
    assert len(shown) == 7
    for one in shown:
        assert one.points.shape == (1000, *shape)


def test_the_covariances_of_a_class_are_one_profile():
    one, = lasa.data_set('Sine', lasa.COVARIANCES)
    assert one.manifold == SymmetricPositiveDefinite(2)


def test_the_riemannian_data_set_is_written_as_archives(tmp_path, capsys):
    words = ['examples', 'lasa', 'Line', '--manifold', 'SO3', '-o', str(tmp_path)]
    assert main(words) == 0
    with np.load(tmp_path / 'Line_SO3.npz', allow_pickle=False) as found:
        assert len(found.files) == 14
        expected = lasa.data_set('Line', 'SO3')[6].points
        assert np.array_equal(found['points_7'], expected)
    assert main(words) == 1 and 'exists already' in capsys.readouterr().err
    assert main([*words, '--overwrite']) == 0
    (tmp_path / 'file').touch()
    assert main([*words[:-1], str(tmp_path / 'file')]) == 1
    (tmp_path / 'file').unlink()
    assert main(['examples', 'lasa', 'Elephant', '--manifold', 'R2', '-o', str(tmp_path)]) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ['Line_SO3.npz']


def test_letters_are_read_and_mapped(tmp_path):
    letter(tmp_path, 'B')
    letter(tmp_path, 'A')
    (tmp_path / 'readme.mat').touch()
    assert [path.stem for path in public_sets.files(tmp_path)] == ['A', 'B']
    strokes = public_sets.strokes(tmp_path / 'A.mat')
    assert len(strokes) == 2 and strokes[0].positions.shape == (200, 2)
    assert strokes[0].times[-1] == pytest.approx(1.99)
    for mapping in lasa.MAPPINGS:
        assert len(public_sets.on_manifold(strokes[0], mapping).points) == 200
    values = np.linalg.eigvalsh(public_sets.manipulability(strokes[0]).points)
    assert values.min() > 1e-3


def test_files_that_are_no_letters_are_refused(tmp_path):
    with pytest.raises(DataError, match='no letters there.*public'):
        public_sets.files(tmp_path)
    (tmp_path / 'A.mat').write_bytes(b'not a file of MATLAB at all' * 20)
    with pytest.raises(DataError, match='A.mat: not a letter'):
        public_sets.strokes(tmp_path / 'A.mat')
    savemat(str(tmp_path / 'B.mat'), {'other': np.eye(2)})
    with pytest.raises(DataError, match='B.mat: not a letter'):
        public_sets.strokes(tmp_path / 'B.mat')
    with pytest.raises(DataError, match='demonstration 2 has shape'):
        public_sets.strokes(letter(tmp_path, 'C', ((2, 200), (1, 200))))
    damaged = letter(tmp_path, 'D')
    raw = bytearray(damaged.read_bytes())
    raw[200:260] = bytes(60)
    damaged.write_bytes(bytes(raw))
    with pytest.raises(DataError, match='D.mat'):
        public_sets.strokes(damaged)
    savemat(str(tmp_path / 'E.mat'), {'demos': np.empty((1, 0), dtype=object)})
    with pytest.raises(DataError, match='no demonstrations'):
        public_sets.strokes(tmp_path / 'E.mat')
    with pytest.raises(DataError, match='F.mat: demonstration 1.*never moves'):
        public_sets.strokes(letter(tmp_path, 'F', still=True))
    assert experiments('paper', 'letters', '--letters', tmp_path / 'nowhere').returncode == 1

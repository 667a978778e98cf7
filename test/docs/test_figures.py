"""Figures in the pages agree with the files that were measured."""
import importlib.util
from pathlib import Path
import shutil

DOCS = Path(__file__).parents[2] / 'docs'
spec = importlib.util.spec_from_file_location('figures', DOCS / 'figures.py')
figures = importlib.util.module_from_spec(spec)
spec.loader.exec_module(figures)


def copy_pages(folder):
    for path in (DOCS / 'figures.yaml', *DOCS.glob('*.md')):
        shutil.copy(path, folder)
    shutil.copytree(DOCS / 'figures', folder / 'figures')


def test_all_figures_agree():
    assert figures.problems() == []


def test_a_figure_that_was_changed_is_found(tmp_path):
    copy_pages(tmp_path)
    page = tmp_path / 'obstacles.md'
    page.write_text(page.read_text().replace('| the bend alone | 92 %', '| the bend alone | 99 %'))
    (wrong,) = figures.problems(tmp_path)
    assert 'the bend alone | 92 %' in wrong and 'bench-obstacles.json' in wrong


def test_figures_are_written_into_their_places(tmp_path):
    copy_pages(tmp_path)
    before = (tmp_path / 'performance.md').read_text()
    page = tmp_path / 'performance.md'
    row = next(line for line in before.splitlines() if line.startswith('| pose + SPD(3) stiff'))
    page.write_text(before.replace(row, '| pose + SPD(3) stiffness | 77.7 | 99 × |'))
    assert len(figures.problems(tmp_path)) == 1
    figures.write(tmp_path)
    assert figures.problems(tmp_path) == [] and page.read_text() == before

"""The scripts in examples/ are short, run, and leave their picture; the gallery shows them all."""
import ast
import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / 'examples').glob('*.py'))


@pytest.mark.long
@pytest.mark.parametrize('script', EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_leaves_a_picture(script, tmp_path):
    shutil.copy(script, tmp_path)
    done = subprocess.run([sys.executable, script.name], cwd=tmp_path, capture_output=True,
                          text=True, env={**os.environ, 'MPLBACKEND': 'Agg'}, timeout=300)
    assert done.returncode == 0, done.stderr[-3000:]
    assert (tmp_path / f'{script.stem}.png').stat().st_size > 8_000


def test_examples_are_short_and_in_the_gallery():
    page = (ROOT / 'docs' / 'examples.md').read_text()
    for script in EXAMPLES:
        lines = script.read_text().splitlines()
        assert len(lines) <= 60, script
        idea = ast.get_docstring(ast.parse('\n'.join(lines)))
        assert idea in page and f'pictures/examples/{script.stem}.png' in page, script
        assert (ROOT / 'docs' / 'pictures' / 'examples' / f'{script.stem}.png').is_file()

"""Control at its limits: a few draws of each case; `python -m experiments limits` has hundreds."""
import json

import pytest

from experiments.__main__ import PROGRAM
from experiments.control_limits import CASES, rows


@pytest.mark.parametrize('plant', ['clean', pytest.param('real', marks=pytest.mark.long)])
@pytest.mark.parametrize('case', list(CASES))
def test_it_holds(case, plant):
    found = rows((case, plant, 2))
    assert found and not [row for row in found if not row['holds']]


@pytest.mark.long
@pytest.mark.parametrize('plant', ['clean', 'real'])
@pytest.mark.parametrize('case', ['streams', 'joint-streams'])
def test_random_streams_hold(case, plant):
    found = rows((case, plant, 20))
    assert found and not [row for row in found if not row['holds']]


def test_rows_are_written_and_unknown_names_are_refused(tmp_path, capsys):
    path = tmp_path / 'limits.json'
    assert PROGRAM.main(['limits', 'speeds', '--plant', 'clean', '--json', str(path)]) == 0
    for row in json.loads(path.read_text()):
        assert set(row) == {'case', 'plant', 'asked', 'measured', 'holds'}
        assert row['plant'] == 'clean' and row['holds']
    assert PROGRAM.main(['limits', 'nothing']) == 1
    assert "case 'nothing' is unknown" in capsys.readouterr().err

"""Learning at its edges: a few draws of each case; `python -m experiments edges` has hundreds."""
import json

import pytest

from experiments.__main__ import PROGRAM
from experiments.edges import CASES, draw, rows

DRAWS = 6


@pytest.mark.parametrize('case', CASES)
def test_every_draw_holds(case):
    for row in rows(case, [draw((case, 1000 + seed)) for seed in range(DRAWS)]):
        assert row['holds'], row


def test_the_rows_are_written_and_an_unknown_case_is_refused(tmp_path, capsys):
    path = tmp_path / 'edges.json'
    assert PROGRAM.main(['edges', 'bursts', '--draws', '2', '--json', str(path)]) == 0
    written = json.loads(path.read_text())
    assert {'case', 'asked', 'measured', 'holds'} <= set(written[0])
    assert 'bursts: acceleration / clean' in capsys.readouterr().out
    assert PROGRAM.main(['edges', 'nothing']) == 1


def test_a_draw_that_does_not_hold_is_told():
    kept, broken = ({bound.name: value for bound in CASES['rates'][1]} for value in (0.5, 100.0))
    assert not any(row['holds'] for row in rows('rates', [kept, broken]))
    assert all(row['holds'] for row in rows('rates', [kept, kept]))

"""Tables of contexts."""
import pytest

from gdmp_ros.data.takes import read_numbers
from gdmp_ros.errors import DataError


def test_numbers_are_found_by_the_names_of_the_takes(tmp_path):
    table = tmp_path / 'contexts.csv'
    table.write_text('take, height, weight\nb, 0.05, 2\n\na, 0.02, 1\nunused, 1, 1\n')
    assert read_numbers(table, ['a', 'b']) == {'height': [0.02, 0.05], 'weight': [1.0, 2.0]}


@pytest.mark.parametrize('text, reason', [
    ('', "expected 'take'"), ('name,height\na,1\n', "expected 'take'"), ('take\na\n', 'names'),
    ('take,height,height\na,1,1\n', 'different names'), ('take,height\na,1\n', 'no line for b'),
    ('take,height\na,1\na,2\nb,1\n', "line 3: 'a' occurs twice"),
    ('take,height\na,high\nb,1\n', "line 2, height: 'high' is not"),
    ('take,height\na,nan\nb,1\n', "'nan' is not a finite"),
    ('take,height\na,1,2\nb,1\n', 'line 2: 3 entries, expected 2'),
    ('take,height\n"a' + 200_000 * 'x', 'not a CSV')])
def test_damaged_tables_are_refused(tmp_path, text, reason):
    table = tmp_path / 'contexts.csv'
    table.write_text(text)
    with pytest.raises(DataError, match=reason):
        read_numbers(table, ['a', 'b'])


def test_a_missing_table_is_named(tmp_path):
    with pytest.raises(DataError, match='none.csv'):
        read_numbers(tmp_path / 'none.csv', ['a'])

"""Arrays by name from files of other programs: text, NumPy, MATLAB, HDF5, Parquet."""
from __future__ import annotations

from collections.abc import Sequence
import csv
import gzip
from pathlib import Path
import re
from typing import Any

import numpy as np

from gdmp_ros.data.labels import COPY
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.util.optional_imports import extra, optional_import

#: Suffixes of files that are read.
SUFFIXES = ('.csv', '.txt', '.tsv', '.tum', '.gz', '.npz', '.npy', '.mat', '.h5', '.hdf5',
            '.parquet')
#: Those of HDF5, in which images may stand beside what is read.
HDF5 = ('.h5', '.hdf5')
#: Largest file that is read, and most data that is read of an HDF5 file [bytes].
LARGEST = 2_000_000_000
#: Columns of a file without names whose numbers are separated by spaces, as evo writes them.
TUM = ('timestamp [s]', 'tx', 'ty', 'tz', 'qx', 'qy', 'qz', 'qw')
#: Lines from which the format of a text is told.
_SNIFFED = 20
#: Larger integers are not exact as floating-point numbers.
_EXACT = 2.0 ** 53


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """
    Numeric arrays in a file, by name.

    In HDF5 a name is the way through the groups, such as ``data/demo_0/actions``.

    :raises DataError: naming the file and what is wrong with it
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise DataError(f'{path}: format not read; use a file that ends in {", ".join(SUFFIXES)}')
    reader = {'.npz': _npz, '.npy': _npy, '.mat': _mat, '.h5': _hdf5, '.hdf5': _hdf5,
              '.parquet': _parquet}.get(suffix, _text)
    try:
        if not path.is_file():
            raise DataError(f'{path}: not a file')
        if suffix not in HDF5 and path.stat().st_size > LARGEST:
            raise DataError(f'{path}: has {path.stat().st_size} bytes, expected at most '
                            f'{LARGEST}')
        result = reader(path)
    except GdmpError:
        raise
    except Exception as error:  # libraries pass on errors of struct, zlib, codecs …
        raise DataError(f'{path}: cannot be read ({type(error).__name__}: {error})') from None
    return {name: array for name, array in result.items() if array.ndim >= 1 and array.size}


def _numbers(given: Any) -> np.ndarray | None:
    """Numbers as an array, and dates in ns; None if they are neither."""
    array = np.asarray(given)
    if array.dtype.kind in 'mM':
        return (array.astype('datetime64[ns]').astype(np.int64) if array.dtype.kind == 'M'
                else array.astype('timedelta64[ns]').astype(np.int64))
    # Stamps in ns are exact as integers only.
    if array.dtype.kind in 'iu' and array.ndim == 1:
        return array.astype(np.int64)
    return array.astype(float) if array.dtype.kind in 'fiub' else None


def _named(name: str, given: Any) -> str:
    """The name of an array; that of dates tells their unit here."""
    return f'{name} [ns]' if np.asarray(given).dtype.kind in 'mM' else name


def _text(path: Path) -> dict[str, np.ndarray]:
    """Columns of a text file: with a heading, or as TUM (evo) writes them."""
    with (gzip.open if path.suffix.lower() == '.gz' else open)(path, 'rb') as stream:
        data = stream.read(LARGEST + 1)
    if len(data) > LARGEST:
        raise DataError(f'{path}: has more than {LARGEST} bytes')
    if b'\0' in data:
        raise DataError(f'{path}: it is no text')
    lines = [(number, line.strip()) for number, line in enumerate(
        data.decode('utf-8-sig').splitlines(), 1) if line.strip()]
    if not lines:
        raise DataError(f'{path}: there is nothing in it')
    if lines[0][1].startswith('Format Version'):
        return _motive(path, lines)
    comments = [line.lstrip('#%/ ') for _, line in lines if line[0] in '#%' or line[:2] == '//']
    rows = [(number, line) for number, line in lines if line[0] not in '#%' and line[:2] != '//']
    if not rows:
        raise DataError(f'{path}: there are comments only')
    delimiter, comma = _format([line for _, line in rows[1:_SNIFFED]] or [rows[0][1]])
    first = _split(rows[0][1], delimiter)
    if not any(_is_number(part, comma) for part in first):
        heading, rows = first, rows[1:]
    else:
        heading = next((parts for comment in reversed(comments) for d in (',', ';', '\t', None)
                        if len(parts := _split(comment, d)) == len(first) > 1), [])
        if not heading and len(first) == len(TUM) and delimiter is None:
            heading = list(TUM)
        if not heading:
            raise DataError(f'{path}: the first line has numbers, expected the names of the '
                            'columns')
    return _columns(path, _distinct(heading), rows, delimiter, comma)


def _format(lines: list[str]) -> tuple[str | None, bool]:
    """Delimiter (None: spaces), and whether numbers have a decimal comma."""
    for delimiter in (';', '\t', ',', None):
        widths = {len(_split(line, delimiter)) for line in lines}
        if len(widths) == 1 and widths != {1}:
            parts = [part for line in lines for part in _split(line, delimiter)]
            comma = delimiter != ',' and any(
                ',' in part and _is_number(part, True) for part in parts)
            if delimiter == ',' and all(_is_number(part, True) for line in lines
                                        for part in line.split()) and ' ' in lines[0]:
                continue  # spaces between numbers with a decimal comma
            return delimiter, comma
    return ',', False


def _split(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    if '"' in line:
        return [part.strip() for part in next(csv.reader([line], delimiter=delimiter))]
    return [part.strip() for part in line.split(delimiter)]


def _distinct(heading: list[str]) -> list[str]:
    """Names; of those that occur more than once, the others get a number: ``x``, ``x#2``."""
    result: list[str] = []
    bare = [name.strip().strip('"') or 'index' for name in heading]
    # So pandas names columns that occur more than once.
    copies = [name for name in bare if re.fullmatch(r'.+\.[0-9]+', name)
              and name.rpartition('.')[0] in bare]
    for name in bare:
        if name in copies and len(copies) > 1:
            base, _, number = name.rpartition('.')
            name = f'{base}{COPY}{int(number) + 1}'
        taken = sum(other.partition(COPY)[0] == name for other in result)
        result.append(f'{name}{COPY}{taken + 1}' if taken and COPY not in name else name)
    return result


def _columns(path: Path, names: list[str], rows: list[tuple[int, str]], delimiter: str | None,
             comma: bool) -> dict[str, np.ndarray]:
    """
    Numbers of each column.

    :param rows: line numbers and lines
    """
    if not rows:
        raise DataError(f'{path}: no row of numbers below the heading {" ".join(names)[:60]!r}')
    text = [line.replace(',', '.') if comma else line for _, line in rows]
    try:
        table = np.loadtxt(text, delimiter=delimiter, ndmin=2, comments=None)
        if table.shape[1] != len(names):
            raise ValueError
    except ValueError:
        return _mixed(path, names, [(number, _split(line, delimiter))
                                    for (number, _), line in zip(rows, text)])
    large = set(np.flatnonzero(np.nanmax(np.abs(table), axis=0) > _EXACT).tolist())
    cells = list(zip(*(_split(line, delimiter) for line in text))) if large else []
    return dict(_column(name, cells[i]) if i in large else (name, table[:, i])
                for i, name in enumerate(names))


def _mixed(path: Path, names: list[str], rows: list[tuple[int, list[str]]]
           ) -> dict[str, np.ndarray]:
    """Numbers of each column, where some cells are no numbers."""
    for number, cells in rows:
        if len(cells) != len(names):
            raise DataError(f'{path}, line {number}: {len(cells)} numbers, expected '
                            f'{len(names)}')
    result = dict(map(_column, names, zip(*(cells for _, cells in rows))))
    # A column without any number is a label.
    return {name: array for name, array in result.items() if np.isfinite(array).any()}


def _column(name: str, cells: Sequence[str]) -> tuple[str, np.ndarray]:
    """A column as numbers; of dates, the name tells the unit."""
    if all(re.fullmatch(r'[-+]?[0-9]{16,18}|[-+]?[0-9]{19}', cell) for cell in cells):
        return name, np.array([int(cell) for cell in cells], dtype=np.int64)
    if cells and re.match(r'[0-9]{4}-[0-9]{2}-[0-9]{2}[T ]', cells[0]):
        stamps = [re.sub(r'(Z|[+-][0-9]{2}:?[0-9]{2})$', '', cell) for cell in cells]
        return f'{name} [ns]', np.array(stamps, dtype='datetime64[ns]').astype(np.int64)
    return name, np.array([float(cell) if _is_number(cell, False) else np.nan for cell in cells])


def _is_number(text: str, comma: bool) -> bool:
    try:
        float(text.replace(',', '.') if comma else text)
    except ValueError:
        return False
    return True


def _motive(path: Path, lines: list[tuple[int, str]]) -> dict[str, np.ndarray]:
    """
    Columns of an export of OptiTrack Motive: names, kinds and axes in lines of their own.

    Its axes are those of the cameras: y points up.
    """
    cells = [(number, _split(line, ',')) for number, line in lines]
    about = dict(zip(cells[0][1][::2], cells[0][1][1::2]))
    at = next((i for i, (_, row) in enumerate(cells) if row[:1] == ['Frame']), None)
    if at is None:
        raise DataError(f'{path}: an export of Motive without a line that begins with Frame')
    axes = cells[at][1]
    above = {row[1]: row for _, row in cells[1:at] if len(row) == len(axes) and row[1]}
    kinds = cells[at - 1][1]
    unit = {'Meters': 'm', 'Millimeters': 'mm', 'Centimeters': 'cm'}.get(
        about.get('Length Units', ''), '')
    names = []
    for i, axis in enumerate(axes):
        body = above.get('Name', axes)[i] if i > 1 else ''
        kind = kinds[i] if i > 1 and i < len(kinds) else ''
        named = ' '.join(part for part in (body.replace(':', '_'), kind, axis) if part)
        names.append(f'{named} [{unit}]' if kind == 'Position' and unit else named)
    return _columns(path, _distinct(names), lines[at + 1:], ',', False)


def _npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as result:
        arrays = {name: result[name] for name in result.files}
    labels = {array.size: array.reshape(-1).tolist() for array in arrays.values()
              if array.dtype.kind == 'U' and array.size > 1}
    found: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        numbers = _numbers(array)
        if numbers is not None and numbers.ndim == 2 and numbers.shape[1] in labels:
            found.update(zip(_distinct(labels[numbers.shape[1]]), numbers.T))
        elif numbers is not None:
            found[_named(name, array)] = numbers
    return found


def _npy(path: Path) -> dict[str, np.ndarray]:
    array = np.load(path, allow_pickle=False)
    if array.dtype.names:
        return {_named(name, array[name]): numbers for name in array.dtype.names
                if (numbers := _numbers(array[name])) is not None}
    numbers = _numbers(array)
    return {} if numbers is None else {path.stem: numbers}


def _mat(path: Path) -> dict[str, np.ndarray]:
    from scipy.io import loadmat
    try:
        result = loadmat(path, squeeze_me=True)
    except NotImplementedError:
        return _hdf5(path)  # MATLAB 7.3
    arrays = {name: _numbers(array) for name, array in result.items() if not name.startswith('__')}
    return {name: array for name, array in arrays.items() if array is not None}


def _hdf5(path: Path) -> dict[str, np.ndarray]:
    with optional_import(extra('datasets')):
        import h5py
    result: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.dtype.kind in 'fiub' and item.ndim in (1, 2, 3):
            result[name] = item
    with h5py.File(path, 'r') as file:
        file.visititems(visit)
        size = sum(item.size * np.dtype(float).itemsize for item in result.values())
        if size > LARGEST:
            raise DataError(f'{path}: its numbers take {size} bytes, expected at most {LARGEST}')
        return {name: np.asarray(item[()], dtype=float) for name, item in result.items()}


def _parquet(path: Path) -> dict[str, np.ndarray]:
    with optional_import(extra('datasets')):
        import pyarrow.parquet as pq
    table, result = pq.read_table(path), {}
    for name in table.column_names:
        values = _stacked(table[name])
        array = _numbers(values)
        if array is not None:
            result[_named(name, values)] = array
    return result


def _stacked(column: Any) -> np.ndarray:
    """A column of numbers or dates, or rows of one array if all have the same length."""
    if not str(column.type).startswith(('list', 'fixed_size_list', 'large_list')):
        return np.asarray(column.to_numpy())
    try:
        return np.array(column.to_pylist(), dtype=float)
    except ValueError:
        return np.array(['rows of different lengths'])

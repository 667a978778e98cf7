"""Arrays by name from files of other programs: CSV, NumPy, MATLAB, HDF5, Parquet."""
from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.util.optional_imports import extra, optional_import

#: Suffixes of files that are read.
SUFFIXES = ('.csv', '.npz', '.mat', '.h5', '.hdf5', '.parquet')
#: Those of HDF5, in which images may stand beside what is read.
HDF5 = ('.h5', '.hdf5')
#: Largest file that is read, and most data that is read of an HDF5 file [bytes].
LARGEST = 2_000_000_000


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """
    Numeric arrays in a file, by name.

    In HDF5 a name is the way through the groups, such as ``data/demo_0/actions``.

    :raises DataError: naming the file and what is wrong with it
    """
    reader = {'.csv': _csv, '.npz': _npz, '.mat': _mat, '.h5': _hdf5, '.hdf5': _hdf5,
              '.parquet': _parquet}.get(path.suffix.lower())
    if reader is None:
        raise DataError(f'{path}: expected a file that ends in {", ".join(SUFFIXES)}')
    try:
        if not path.is_file():
            raise DataError(f'{path}: not a file')
        if path.suffix.lower() not in HDF5 and path.stat().st_size > LARGEST:
            raise DataError(f'{path}: has {path.stat().st_size} bytes, expected at most '
                            f'{LARGEST}')
        result = reader(path)
    except GdmpError:
        raise
    except Exception as error:  # libraries pass on errors of struct, zlib, codecs …
        raise DataError(f'{path}: cannot be read ({type(error).__name__}: {error})') from None
    return {name: array for name, array in result.items() if array.ndim >= 1 and array.size}


def _numbers(given: Any) -> np.ndarray | None:
    """Numbers as an array; None if they are none."""
    array = np.asarray(given)
    return array.astype(float) if array.dtype.kind in 'fiub' else None


def _csv(path: Path) -> dict[str, np.ndarray]:
    with path.open(newline='') as text:
        sample = text.read(20_000)
        text.seek(0)
        try:
            dialect: Any = csv.Sniffer().sniff(sample, ',;\t ')
        except csv.Error:
            dialect = csv.excel
        rows = [row for row in csv.reader(text, dialect) if any(row)]
    if not rows:
        raise DataError(f'{path}: there is nothing in it')
    names = [name.strip().lstrip('#').strip() for name in rows[0]]
    if all(_is_number(name) for name in names):
        raise DataError(f'{path}: the first line has numbers, expected the names of the columns')
    columns: list[list[float]] = [[] for _ in names]
    for line, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise DataError(f'{path}, line {line}: {len(row)} numbers, expected {len(names)}')
        for column, value in zip(columns, row):
            column.append(float(value) if _is_number(value) else np.nan)
    arrays = {name: np.array(column) for name, column in zip(names, columns)}
    # A column without any number is a label.
    return {name: array for name, array in arrays.items() if np.isfinite(array).any()}


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as result:
        arrays = {name: _numbers(result[name]) for name in result.files}
    return {name: array for name, array in arrays.items() if array is not None}


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
        array = _numbers(_stacked(table[name].to_pylist()))
        if array is not None:
            result[name] = array
    return result


def _stacked(values: list[Any]) -> Any:
    """Rows of one array, if all have the same length."""
    try:
        return np.array(values)
    except ValueError:
        return np.array(['rows of different lengths'])

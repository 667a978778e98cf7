"""Files that are read whole, and written whole or not at all."""
from __future__ import annotations

from collections.abc import Mapping
import json
import os
from pathlib import Path
import tempfile
from typing import Any

import numpy as np

from gdmp_ros.errors import DataError


def write_text(path: Path, text: str) -> None:
    """Write a text file (see `write_bytes`)."""
    write_bytes(path, text.encode())


def write_bytes(path: Path, content: bytes) -> None:
    """
    Write a file in a temporary place and move it to ``path``.

    :raises OSError: if it cannot be written; an old file stays
    """
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
    try:
        with os.fdopen(handle, 'wb') as out:
            out.write(content)
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    except BaseException:
        os.unlink(partial)
        raise


def write_json(path: Path, document: Any) -> None:
    """Write plain values as indented JSON (see `write_text`)."""
    write_text(path, json.dumps(document, indent=1) + '\n')


def write_archive(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """
    Write a compressed NumPy archive of named arrays.

    :param path: ending in ``.npz``
    """
    partial = path.with_name(f'.{path.stem}.partial.npz')
    np.savez_compressed(partial, **arrays)  # type: ignore[arg-type]
    partial.replace(path)


def read_text(path: Path, what: str, most: int) -> str:
    """
    Text of a file.

    :param what: it is to be, for messages
    :param most: size that is allowed [bytes]
    :raises DataError: if it cannot be read, is a folder or a device, larger, or not UTF-8
    """
    try:
        if path.exists() and not path.is_file():
            raise DataError(f'{path}: not a {what} file: it is a folder or a device')
        size = path.stat().st_size
        if size > most:
            raise DataError(f'{path}: not a {what} file: it has {size} bytes, expected at most '
                            f'{most}')
        return path.read_text()
    except UnicodeDecodeError as error:
        raise DataError(f'{path}: not a {what} file: {error}') from None
    except OSError as error:
        raise DataError(f'{path}: cannot read the {what}: {error.strerror}') from None


def parse_yaml(text: str, path: Path, what: str) -> Any:
    """
    Read a YAML document.

    :param what: it is to be, for messages
    :raises DataError: if it is no YAML
    """
    import yaml  # not needed by most commands
    try:
        return yaml.safe_load(text)
    # Wrong dates, tags and numbers are not all errors of YAML.
    except (yaml.YAMLError, ValueError, LookupError, TypeError, OverflowError,
            RecursionError) as error:
        raise DataError(f'{path}: not a {what} file: {" ".join(str(error).split())}') from None

"""Text files that are read whole."""
from __future__ import annotations

from pathlib import Path

from gdmp_ros.errors import DataError


def read_text(path: Path, what: str, most: int) -> str:
    """
    Text of a file.

    :param what: it is to be, for messages
    :param most: size that is allowed [bytes]
    :raises DataError: if it cannot be read, is a folder or a device, or larger
    :raises UnicodeDecodeError: if it is not UTF-8
    """
    try:
        if path.exists() and not path.is_file():
            raise DataError(f'{path}: not a {what} file: it is a folder or a device')
        size = path.stat().st_size
        if size > most:
            raise DataError(f'{path}: not a {what} file: it has {size} bytes, expected at most '
                            f'{most}')
        return path.read_text()
    except OSError as error:
        raise DataError(f'{path}: cannot read the {what}: {error.strerror}') from None

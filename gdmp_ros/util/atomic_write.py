"""Text files that are written whole or not at all."""
from __future__ import annotations

import json
import os
from pathlib import Path
import tempfile
from typing import Any


def write_text(path: Path, text: str) -> None:
    """
    Write beside ``path`` first and move it there: a reader sees the old file or the new one.

    :raises OSError: if it cannot be written; the old file stays
    """
    handle, partial = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
    try:
        with os.fdopen(handle, 'w') as out:
            out.write(text)
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    except BaseException:
        os.unlink(partial)
        raise


def write_json(path: Path, document: Any) -> None:
    """Write plain values as indented JSON, whole or not at all (see `write_text`)."""
    write_text(path, json.dumps(document, indent=1) + '\n')

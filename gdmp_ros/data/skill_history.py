"""Earlier versions of a skill file, so that a change can be undone exactly."""
from __future__ import annotations

import os
from pathlib import Path
import shutil

from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError


def history_of(path: Path) -> Path:
    """Folder with the earlier versions of a skill file."""
    return path.with_name(f'{path.name}.history')


def versions(path: Path) -> list[Path]:
    """Earlier versions, the oldest first."""
    return sorted(history_of(path).glob('[0-9][0-9][0-9][0-9].json'))


def replace(path: Path, skill: Skill) -> None:
    """
    Write a skill in place of a file; the file becomes an earlier version.

    :raises DataError: if it cannot be written; the file stays
    """
    earlier = versions(path)
    number = int(earlier[-1].stem) + 1 if earlier else 1
    kept = history_of(path) / f'{number:04d}.json'
    try:
        kept.parent.mkdir(exist_ok=True)
        shutil.copyfile(path, kept)
    except OSError as error:
        raise DataError(f'{kept}: cannot keep the earlier version: {error.strerror}') from None
    try:
        skill.save(path)
    except DataError:
        kept.unlink()
        raise


def undo(path: Path) -> None:
    """
    Bring the last earlier version back, byte by byte.

    :raises DataError: if there is none
    """
    earlier = versions(path)
    if not earlier:
        raise DataError(f'{path}: there is no earlier version to go back to')
    try:
        os.replace(earlier[-1], path)
        if len(earlier) == 1:
            history_of(path).rmdir()
    except OSError as error:
        raise DataError(f'{path}: cannot bring {earlier[-1]} back: {error.strerror}') from None

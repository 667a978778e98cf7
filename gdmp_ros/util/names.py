"""Names of the same things in two places."""
from __future__ import annotations

from collections.abc import Sequence
import re

from gdmp_ros.errors import DataError


def indices_of(wanted: Sequence[str], given: Sequence[str], what: str) -> list[int]:
    """
    Where names are among others, which may have a prefix more or less: ``panda_joint1``.

    Numbered joints may have different prefixes: ``fr3_joint1``. A finger is no joint of an arm.

    :param what: they are of, for messages
    :raises DataError: if a name is missing, or there are several
    """
    return [_index_of(name, given, what) for name in wanted]


#: The end of the name of a numbered joint of an arm.
_NUMBERED = re.compile(r'(?:^|_)(joint_?\d+)$')


def _number(name: str) -> str:
    """``joint1`` of ``panda_joint1``; empty for other names."""
    found = _NUMBERED.search(name)
    return found.group(1) if found and 'finger' not in name else ''


def _index_of(name: str, given: Sequence[str], what: str) -> int:
    for alike in (lambda other: other == name,
                  lambda other: (other.endswith(name) or name.endswith(other))
                  and ('finger' in other) == ('finger' in name),
                  lambda other: _number(other) == _number(name) != ''):
        found = [index for index, other in enumerate(given) if other and alike(other)]
        if len(found) == 1:
            return found[0]
        if found:
            raise DataError(f'{what} {name!r} is there {len(found)} times, expected once: '
                            f'{", ".join(given)}')
    raise DataError(f'{what} {name!r} is missing; there are {", ".join(given) or "none"}')

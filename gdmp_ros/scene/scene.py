"""A scene: named volumes around an arm, from a file or from messages."""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.scene.volume import CAPACITY, DEFAULT_MARGIN, Volume, VOLUME_SIZE
from gdmp_ros.util.files import parse_yaml, read_text, write_text
from gdmp_ros.util.numeric import numbers

#: Larger files are refused [bytes].
MAX_BYTES = 1_000_000
_KEYS = {'name', 'kind', 'size', 'pose', 'position', 'margin', 'allowed', 'carried'}
_STILL = [1.0, 0.0, 0.0, 0.0]


class Scene:
    """
    Volumes by their names; at most `CAPACITY`.

    :ivar margin: distance that is kept from volumes without a margin of their own [m]
    """

    def __init__(self, volumes: tuple[Volume, ...] | list[Volume] = (),
                 margin: float = DEFAULT_MARGIN):
        """:raises DataError: if two have one name, or there are too many"""
        if not 0.0 <= margin <= 1.0:
            raise DataError(f'margin is {margin} m, expected 0 to 1')
        self.margin = margin
        self._volumes: dict[str, Volume] = {}
        for volume in volumes:
            if volume.name in self._volumes:
                raise DataError(f'two volumes have the name {volume.name!r}')
            self.put(volume)

    def __iter__(self) -> Iterator[Volume]:
        return iter(self._volumes.values())

    def __len__(self) -> int:
        return len(self._volumes)

    def __getitem__(self, name: str) -> Volume:
        if name not in self._volumes:
            raise DataError(f'the scene has no volume {name!r}')
        return self._volumes[name]

    def __contains__(self, name: object) -> bool:
        return name in self._volumes

    @property
    def around(self) -> list[Volume]:
        """The volumes that the arm does not carry."""
        return [volume for volume in self if not volume.carried]

    @property
    def carried(self) -> np.ndarray:
        """Capsules around what the arm carries, in the frame of the tool, shape (m, 7) [m]."""
        return np.vstack([np.empty((0, 7)), *(one.capsules for one in self if one.carried)])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the volumes `around`, in the order of `packed`."""
        return tuple(volume.name for volume in self.around)

    def put(self, volume: Volume) -> None:
        """
        Add a volume, or put another one in the place of that with its name.

        :raises DataError: if there are too many
        """
        if volume.name not in self._volumes and len(self._volumes) >= CAPACITY:
            raise DataError(f'volume {volume.name!r}: the scene has {CAPACITY} volumes already, '
                            'which is the most')
        self._volumes[volume.name] = volume

    def remove(self, name: str) -> None:
        """Remove a volume, or the parts ``name#1`` and so on of one; none is no error."""
        parts = [known for known in self._volumes
                 if known.startswith(f'{name}#') and known[len(name) + 1:].isdigit()]
        for known in [*parts, *(known for known in self._volumes if known == name)]:
            del self._volumes[known]

    def clear(self) -> None:
        """Remove all volumes."""
        self._volumes.clear()

    def copy(self) -> Scene:
        """Return a scene with the same volumes."""
        return Scene(list(self), self.margin)

    def packed(self, links: Mapping[str, int] | None = None) -> np.ndarray:
        """
        Numbers of the volumes `around` for kernels, shape (m, `VOLUME_SIZE`).

        :param links: the bits of the links of the arm, which volumes may allow to touch them
        :raises DataError: if a volume allows a link that the arm does not have
        """
        rows = [volume.packed(self.margin, dict(links or {})) for volume in self.around]
        return np.array(rows).reshape(-1, VOLUME_SIZE)


def read_scene(path: str | Path) -> Scene:
    """
    Read a scene file (YAML, ``docs/obstacles.md``).

    :raises DataError: with the file, the volume and the reason
    """
    path = Path(path)
    document = parse_yaml(read_text(path, 'scene', MAX_BYTES), path, 'scene')
    if not isinstance(document, dict) or not set(document) <= {'margin', 'volumes'} or (
            not isinstance(document.get('volumes'), list)):
        raise DataError(f'{path}: not a scene file: expected "volumes", a list, and "margin"')
    try:
        margin = document.get('margin', DEFAULT_MARGIN)
        if isinstance(margin, bool) or not isinstance(margin, (int, float)):
            raise DataError(f'margin: expected a number, got {margin!r}')
        return Scene([_volume(number, given)
                      for number, given in enumerate(document['volumes'], 1)], float(margin))
    except GdmpError as error:
        raise DataError(f'{path}: {error}') from None


def write_scene(path: str | Path, scene: Scene) -> None:
    """
    Write a scene file.

    :raises DataError: if it cannot be written
    """
    rows = []
    for volume in scene:
        row: dict[str, Any] = {'name': volume.name, 'kind': volume.kind}
        if volume.size:
            row['size'] = [round(value, 6) for value in volume.size]
        row['pose'] = [round(float(value), 6) for value in volume.pose]
        if volume.margin is not None:
            row['margin'] = volume.margin
        if volume.allowed:
            row['allowed'] = list(volume.allowed)
        if volume.carried:
            row['carried'] = True
        rows.append(row)
    try:
        write_text(Path(path), yaml.safe_dump({'margin': scene.margin, 'volumes': rows},
                                              sort_keys=False, default_flow_style=None))
    except OSError as error:
        raise DataError(f'{path}: cannot write: {error.strerror}') from None


def _volume(number: int, given: Any) -> Volume:
    if not isinstance(given, dict):
        raise DataError(f'volume {number}: expected keys and values, got {given!r:.80}')
    unknown = sorted(str(key) for key in set(given) - _KEYS)
    if unknown:
        raise DataError(f'volume {number}: unknown key {unknown[0]!r}; expected '
                        f'{", ".join(sorted(_KEYS))}')
    name, kind = str(given.get('name', f'volume {number}')), given.get('kind')
    if ('pose' in given) == ('position' in given):
        raise DataError(f'volume {name!r}: expected pose (x, y, z, qw, qx, qy, qz) or position')
    pose = (numbers(f'volume {name!r}: pose', given['pose'], DataError) if 'pose' in given
            else np.concatenate([np.atleast_1d(numbers(
                f'volume {name!r}: position', given['position'], DataError)).ravel(), _STILL]))
    size = np.atleast_1d(numbers(f'volume {name!r}: size', given.get('size', []), DataError))
    allowed, margin = given.get('allowed', []), given.get('margin')
    if not isinstance(allowed, list) or not all(isinstance(link, str) for link in allowed):
        raise DataError(f'volume {name!r}: allowed: expected names of links, got {allowed!r:.80}')
    if margin is not None and (isinstance(margin, bool) or not isinstance(margin, (int, float))):
        raise DataError(f'volume {name!r}: margin: expected a number, got {margin!r}')
    carried = given.get('carried', False)
    if not isinstance(carried, bool):
        raise DataError(f'volume {name!r}: carried: expected true or false, got {carried!r:.80}')
    return Volume(name, str(kind), tuple(size.ravel()), pose, margin=margin,
                  allowed=tuple(allowed), carried=carried)

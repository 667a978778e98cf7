"""Sequence files: YAML with the steps of a sequence, and the skill files they name."""
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.control.gripper import DEFAULT_SPEED
from gdmp_ros.dmp.primitive import GripperEvent
from gdmp_ros.dmp.sequence import GripperStep, HoldStep, MotionStep, SkillSequence, Step
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.dmp.skill_file import MAX_BYTES as SKILL_BYTES
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.util.files import parse_yaml, read_text

#: Larger files are refused [bytes], and so are more steps.
MAX_BYTES, MAX_STEPS = 1_000_000, 1000
#: Keys of each kind of step; the first one tells the kind.
_KEYS = {'skill': ('skill', 'name', 'goal', 'duration', 'cycles', 'until', 'frequency',
                   'amplitude', 'blend'),
         'hold': ('hold', 'name', 'until'), 'gripper': ('gripper', 'name')}
_GRIPPER_KEYS = ('width', 'force', 'speed')


def read_sequence(path: str | Path, contents: dict[str, str] | None = None) -> SkillSequence:
    """
    Read a sequence file; skills are looked for beside it.

    :param contents: of files by their names, which are taken instead of those on the disk, as
        another machine sends them; what is read is added
    :raises DataError: with the file, the step and the reason
    """
    path, contents = Path(path), {} if contents is None else contents
    document = parse_yaml(_contents(path, 'sequence', MAX_BYTES, contents), path, 'sequence')
    if not isinstance(document, dict) or set(document) != {'steps'}:
        raise DataError(f'{path}: not a sequence file: expected "steps" and nothing else')
    steps = document['steps']
    if not isinstance(steps, list) or not 0 < len(steps) <= MAX_STEPS:
        raise DataError(f'{path}: steps: expected a list of 1 to {MAX_STEPS} steps')
    skills: dict[Path, Skill] = {}

    def skill(name: str) -> Skill:
        file = path.parent / name
        if file not in skills:
            skills[file] = Skill.parse(_contents(file, 'skill', SKILL_BYTES, contents), str(file))
        return skills[file]
    result = []
    for number, given in enumerate(steps, 1):
        try:
            result.append(_step(number, given, skill))
        except GdmpError as error:
            raise DataError(f'{path}: step {number}: {error}') from None
    return SkillSequence(result, str(path))


def _contents(path: Path, what: str, most: int, contents: dict[str, str]) -> str:
    if str(path) not in contents:
        contents[str(path)] = read_text(path, what, most)
    return contents[str(path)]


def _step(number: int, given: Any, skills: Callable[[str], Skill]) -> Step:
    kinds = [kind for kind in _KEYS if isinstance(given, dict) and kind in given]
    if len(kinds) != 1:
        raise DataError(f'expected one of {", ".join(_KEYS)}, got {given!r}')
    kind = kinds[0]
    unknown = sorted(str(key) for key in set(given) - set(_KEYS[kind]))
    if unknown:
        raise DataError(f'unknown key {", ".join(unknown)}; expected {", ".join(_KEYS[kind])}')
    if kind == 'hold':
        # Without a number it waits for its signal, however long.
        seconds = np.inf if given['hold'] is None else _number('hold', given['hold'])
        until = _text(given, 'until')
        usual = f'wait for {until}' if until else f'hold {number}'
        return HoldStep(_text(given, 'name') or usual, seconds, until)
    if kind == 'gripper':
        return GripperStep(_text(given, 'name') or f'gripper {number}', _command(given['gripper']))
    return _motion(number, given, skills)


def _motion(number: int, given: dict[str, Any], skills: Callable[[str], Skill]) -> MotionStep:
    name = _text(given, 'skill')
    skill = skills(name)
    numbers = {key: _number(key, given[key])
               for key in ('duration', 'cycles', 'frequency', 'amplitude', 'blend')
               if key in given}
    frequency = numbers.pop('frequency', None)
    if frequency is not None:
        if not skill.rhythmic or 'duration' in numbers or not frequency > 0.0:
            raise DataError(f'frequency is {frequency:g}: it must be above 0, needs a rhythmic '
                            'skill, and excludes a duration')
        numbers['duration'] = 1.0 / frequency
    return MotionStep(_text(given, 'name') or Path(name).stem, skill,
                      _goal(skill, given.get('goal')), until=_text(given, 'until'), **numbers)


def _goal(skill: Skill, given: Any) -> np.ndarray | None:
    """A point: all its numbers, or as many as a pose or position has."""
    if given is None:
        return None
    flat = np.array(skill.manifold.flat(skill.goal))
    try:
        numbers = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f'goal: expected numbers, got {given!r}') from None
    pose = skill.manifold.names[:2] == ('position', 'orientation')
    allowed = sorted({len(flat), *((3, 7) if pose else ())})
    if numbers.ndim != 1 or len(numbers) not in allowed:
        raise DataError(f'goal has {numbers.size} numbers, expected '
                        f'{" or ".join(map(str, allowed))}')
    flat[:len(numbers)] = numbers
    return flat.reshape(skill.manifold.point_shape)


def _command(given: Any) -> GripperEvent:
    if not isinstance(given, dict) or 'width' not in given or set(given) - set(_GRIPPER_KEYS):
        raise DataError(f'gripper: expected width, and force and speed, got {given!r}')
    return GripperEvent(0.0, _number('width', given['width']),
                        _number('force', given.get('force', 0.0)),
                        _number('speed', given.get('speed', DEFAULT_SPEED)))


def _number(name: str, given: Any) -> float:
    try:
        if isinstance(given, (int, float)) and not isinstance(given, bool):
            return float(given)
    except OverflowError:
        raise DataError(f'{name}: the number is too large') from None
    raise DataError(f'{name}: expected a number, got {given!r}')


def _text(given: dict[str, Any], key: str) -> str:
    value = given.get(key, '')
    if not isinstance(value, str) or not (value.isprintable() and '\0' not in value):
        raise DataError(f'{key}: expected text, got {value!r}')
    return value

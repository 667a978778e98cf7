"""The skill file: JSON with a format version; floats read back exactly as written."""
from __future__ import annotations

from dataclasses import asdict, fields
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from gdmp_ros.dmp.coupling import Coupling
from gdmp_ros.dmp.frames import View
from gdmp_ros.dmp.primitive import Gains, GripperEvent, P, Primitive
from gdmp_ros.dmp.segments import Segments
from gdmp_ros.dmp.variation import ContextModel, Variation
from gdmp_ros.errors import DataError, GdmpError
from gdmp_ros.manifolds import from_spec, KINDS, Manifold
from gdmp_ros.manifolds.poses import POSE_SIZE
from gdmp_ros.util.files import read_text, write_text

FORMAT = 'gdmp skill'
#: A file of another version is refused. Skills with task frames have their own version, so that
#: older programs, which do not know frames, refuse them.
VERSION, VERSION_WITH_FRAMES = 8, 9
#: Larger files are refused; a skill of 2000 basis functions on SPD(20) has a tenth [bytes].
MAX_BYTES = 100_000_000
#: Arrays of a `ContextModel`.
_CONTEXT_SHAPES: dict[str, tuple[int | None, ...]] = {
    'takes': (None, None), 'lengths': (None,), 'noise': (None,), 'trend': (None, None),
    'bend': (None, None), 'spread': (None, None), 'timing': (None,)}
_UNITS = {'duration': 's', 'velocity': 'per duration, in the frame at the start',
          **{kind.kind: kind.unit for kind in KINDS}}


def write_primitive(skill: Primitive, path: Path) -> None:
    """Write a skill file, whole or not at all."""
    try:
        write_text(path, primitive_text(skill))
    except (OSError, TypeError, ValueError) as error:
        raise DataError(f'{path}: cannot write the skill: {error}') from None


def primitive_text(skill: Primitive) -> str:
    """
    Contents of a skill file.

    :raises TypeError: if the provenance has values that are no JSON
    :raises ValueError: if a number is not finite
    """
    return json.dumps(_document(skill), indent=1, allow_nan=False, default=_plain) + '\n'


def _document(skill: Primitive) -> dict[str, Any]:
    document = {
        'format': FORMAT, 'version': VERSION_WITH_FRAMES if skill.views else VERSION,
        'manifold': skill.manifold.spec(),
        'connection': skill.connection, 'gains': asdict(skill.gains), 'duration': skill.duration,
        'steps': skill.steps, 'start': skill.start.reshape(-1).tolist(),
        'goal': skill.goal.reshape(-1).tolist(), 'frame': skill.frame.tolist(),
        'velocity': skill.velocity.tolist(), 'weights': skill.weights.tolist(),
        'segments': {'ends': skill.segments.ends.tolist(),
                     'split': list(skill.segments.split),
                     'waypoints': skill.segments.waypoints.tolist()},
        'via': list(skill.via),
        'variation': _variation_document(skill.variation),
        'gripper': [event._asdict() for event in skill.events],
        'rhythmic': skill.rhythmic,
        'couplings': [asdict(coupling) for coupling in skill.couplings],
        'units': _UNITS, 'provenance': dict(skill.provenance)}
    if skill.views:
        document['frames'] = [{'name': view.name, 'pose': view.pose.tolist(),
                               'shares': view.shares.tolist(), 'motion': _document(view.skill),
                               'free_yaw': view.free_yaw, 'grasped': view.grasped}
                              for view in skill.views]
    return document


def _plain(value: object) -> object:
    """What NumPy and paths are in JSON; they come with what a caller says of a skill."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f'{type(value).__name__} is not plain text, numbers or lists of them')


def read_primitive(path: Path, kind: type[P]) -> P:
    """
    Read and validate a skill file.

    :param kind: class of the result
    :raises DataError: naming the file, the field and the reason
    """
    return parse_primitive(read_text(path, 'skill', MAX_BYTES), str(path), kind)


def parse_primitive(text: str, name: str, kind: type[P]) -> P:
    """
    Validate the contents of a skill file.

    :param name: of the file, for errors
    :param kind: class of the result
    :raises DataError: naming the file, the field and the reason
    """
    if len(text) > MAX_BYTES:
        raise DataError(f'{name}: {len(text)} bytes, at most {MAX_BYTES} are read')
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(f'{name}: not a skill file: {error}') from None
    try:
        return kind(**_parse(document, kind))
    except GdmpError as error:
        raise DataError(f'{name}: {error}') from None


def _parse(document: Any, kind: type[P]) -> dict[str, Any]:
    if not isinstance(document, dict) or document.get('format') != FORMAT:
        raise DataError(f'not a skill file: "format" is not {FORMAT!r}')
    if document.get('version') != (VERSION_WITH_FRAMES if 'frames' in document else VERSION):
        raise DataError(f'format version is {document.get("version")!r}, expected {VERSION}, or '
                        f'{VERSION_WITH_FRAMES} with frames')
    manifold = from_spec(document.get('manifold'))
    gains = document.get('gains')
    if not isinstance(gains, dict) or set(gains) != {'alpha_z', 'alpha_x', 'alpha_g'}:
        raise DataError(f'gains: expected alpha_z, alpha_x and alpha_g, got {gains!r}')
    steps = document.get('steps')
    if not isinstance(steps, int) or isinstance(steps, bool) or not 1 <= steps <= 10 ** 8:
        raise DataError(f'steps: expected an integer from 1 to 1e8, got {steps!r}')
    duration = _numbers(document, 'duration', ())
    if not duration > 0.0:
        raise DataError(f'duration is {duration} s, expected > 0')
    weights = _numbers(document, 'weights', (None, manifold.tangent_size))
    if len(weights) < 2:
        raise DataError(f'weights: {len(weights)} basis functions, expected at least 2')
    rhythmic = document.get('rhythmic', False)
    if not isinstance(rhythmic, bool):
        raise DataError(f'rhythmic: expected true or false, got {rhythmic!r}')
    provenance = document.get('provenance', {})
    if not isinstance(provenance, dict):
        raise DataError(f'provenance: expected an object, got {provenance!r}')
    return {
        'manifold': manifold, 'connection': str(document.get('connection')),
        'gains': Gains(**gains), 'start': _point(document, 'start', manifold),
        'goal': _point(document, 'goal', manifold), 'frame': _frame(document, manifold),
        'duration': float(duration),
        'velocity': _numbers(document, 'velocity', (manifold.tangent_size,)), 'weights': weights,
        'steps': steps, 'segments': _segments(document, manifold), 'via': _via(document),
        'variation': _variation(document), 'events': _events(document), 'provenance': provenance,
        'rhythmic': rhythmic, 'couplings': _couplings(document),
        'views': _views(document, kind)}


def _views(document: dict[str, Any], kind: type[P]) -> tuple[View, ...]:
    given = document.get('frames', [])
    needed, others = {'name', 'pose', 'shares', 'motion'}, {'free_yaw', 'grasped'}
    if not isinstance(given, list) or not all(
            isinstance(one, dict) and needed <= set(one) <= needed | others for one in given):
        raise DataError(f'frames: expected objects with name, pose, shares and motion, got '
                        f'{given!r:.100}')
    return tuple(View(str(one['name']), _numbers(one, 'pose', (POSE_SIZE,)),
                      _numbers(one, 'shares', (None, None)), kind(**_parse(one['motion'], kind)),
                      one.get('free_yaw') is True, None if one.get('grasped') is None
                      else float(_numbers(one, 'grasped', ())))
                 for one in given)


def _numbers(document: dict[str, Any], name: str, shape: tuple[int | None, ...]) -> np.ndarray:
    try:
        array = np.array(document.get(name), dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f'{name}: expected numbers') from None
    if array.ndim != len(shape) or any(size is not None and got != size
                                       for got, size in zip(array.shape, shape)):
        expected = tuple('any' if size is None else size for size in shape)
        raise DataError(f'{name}: shape is {array.shape}, expected {expected}')
    if not np.isfinite(array).all():
        raise DataError(f'{name}: an entry is not a finite number')
    return array


def _point(document: dict[str, Any], name: str, manifold: Manifold) -> np.ndarray:
    flat = _numbers(document, name, (math.prod(manifold.point_shape),))
    try:
        return manifold.check_point(flat.reshape(manifold.point_shape))
    except GdmpError as error:
        raise DataError(f'{name}: {error}') from None


def _via(document: dict[str, Any]) -> tuple[float, ...]:
    given = _numbers({'via': document.get('via', [])}, 'via', (None,))
    if not (np.diff(given, prepend=0.0, append=1.0) > 0.0).all():
        raise DataError(f'via: must increase between 0 and 1, got {given.tolist()}')
    return tuple(given.tolist())


def _events(document: dict[str, Any]) -> tuple[GripperEvent, ...]:
    given, names = document.get('gripper', []), GripperEvent._fields
    if not isinstance(given, list):
        raise DataError(f'gripper: expected a list, got {given!r}')
    for item in given:
        if not isinstance(item, dict) or set(item) != set(names):
            raise DataError(f'gripper: expected objects with {", ".join(names)}, got {item!r}')
    rows = _numbers({'gripper': [[each[name] for name in names] for each in given]}, 'gripper',
                    (None, len(names))) if given else ()
    return tuple(GripperEvent(*row) for row in rows)


def _couplings(document: dict[str, Any]) -> tuple[Coupling, ...]:
    given, names = document.get('couplings', []), [part.name for part in fields(Coupling)]
    if not isinstance(given, list):
        raise DataError(f'couplings: expected a list, got {given!r:.100}')
    for item in given:
        if not isinstance(item, dict) or set(item) != set(names) or not (
                isinstance(item['leads'], bool) and isinstance(item['first'], list)
                and isinstance(item['second'], list)):
            raise DataError(f'couplings: expected objects with {", ".join(names)}, '
                            f'got {item!r:.100}')
    return tuple(Coupling(**{**each, 'relation': _numbers(each, 'relation', (None,))})
                 for each in given)


def _variation(document: dict[str, Any]) -> Variation | None:
    given = document.get('variation')
    if given is None:
        return None
    if not isinstance(given, dict):
        raise DataError(f'variation: expected an object, got {given!r}')
    timing = _numbers({'timing': [given.get('timing', 0.0)]}, 'timing', (1,))
    return Variation(_numbers(given, 'factor', (None, None)), _numbers(given, 'noise', (None,)),
                     float(timing[0]), _contexts(given.get('contexts')))


def _variation_document(variation: Variation | None) -> dict[str, Any] | None:
    if variation is None:
        return None
    model = variation.contexts
    return {'factor': variation.factor.tolist(), 'noise': variation.noise.tolist(),
            'timing': variation.timing, 'contexts': None if model is None else {
                'names': list(model.names),
                **{name: getattr(model, name).tolist() for name in _CONTEXT_SHAPES}}}


def _contexts(given: Any) -> ContextModel | None:
    if given is None:
        return None
    names = given.get('names') if isinstance(given, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise DataError(f'contexts: expected an object with names, got {given!r:.100}')
    return ContextModel(tuple(names), *(_numbers(given, name, shape)
                                        for name, shape in _CONTEXT_SHAPES.items()))


def _segments(document: dict[str, Any], manifold: Manifold) -> Segments:
    given = document.get('segments')
    if given is None or (isinstance(given, dict) and given.get('ends') == []):
        return Segments()
    if not isinstance(given, dict):
        raise DataError(f'segments: expected an object, got {given!r}')
    ends = _numbers(given, 'ends', (None,))
    waypoints = _numbers(given, 'waypoints', (len(ends), manifold.point_size))
    split = given.get('split')
    if not (np.diff(ends, prepend=0.0, append=1.0) > 0.0).all():
        raise DataError(f'segments: ends must increase between 0 and 1, got {ends.tolist()}')
    if (not isinstance(split, list) or len(split) != len(manifold.factors)
            or not all(isinstance(item, bool) for item in split)):
        raise DataError(f'segments: split needs {len(manifold.factors)} booleans, got {split!r}')
    for row in waypoints:
        manifold.check_point(row.reshape(manifold.point_shape))
    return Segments(ends, waypoints, tuple(split))


def _frame(document: dict[str, Any], manifold: Manifold) -> np.ndarray:
    """The frame must be at the start: otherwise the roll-out would begin elsewhere."""
    frame = _numbers(document, 'frame', (manifold.frame_size,))
    expected = manifold.frame(_point(document, 'start', manifold))
    if not np.allclose(frame, expected, rtol=1e-9, atol=1e-12):
        raise DataError('frame: it is not the frame at the start')
    return frame



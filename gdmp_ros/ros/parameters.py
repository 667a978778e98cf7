"""Parameters with a description, a unit and a range, declared from one table; and as text."""
from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
import difflib
from typing import Any, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from gdmp_ros.errors import GdmpError, ParameterError
from gdmp_ros.util.settings import about

Settings = TypeVar('Settings')
#: When a changed parameter takes effect.
CHANGES = {'configure': 'read-only while the node is configured', 'live': 'changes at once',
           'motion': 'changes with the next motion'}

#: Parameters of every node that are read when it is configured.
WITH_CONFIGURE = frozenset({'use_sim_time'})


@dataclass(frozen=True)
class Spec:
    """
    One parameter.

    :ivar unit: empty if there is none
    :ivar low: smallest value, None without bound
    :ivar high: largest value
    :ivar choices: the strings allowed
    :ivar changes: when a change takes effect: with the next ``configure`` (until then it is
        refused), ``live``, or with the next ``motion``
    :ivar each: whether an array may have one entry for all, or one for each joint
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    changes: str = 'configure'
    each: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Descriptor for ``ros2 param describe``."""
        unit = f' [{self.unit}]' if self.unit else ''
        result = ParameterDescriptor(
            name=self.name, description=f'{self.description}{unit}; {CHANGES[self.changes]}')
        if self.choices:
            result.additional_constraints = f'one of {", ".join(self.choices)}'
        # Ranges apply to scalars only; `problem` checks the entries of arrays.
        if self.low is not None and self.high is not None and type(self.default) in (int, float):
            if isinstance(self.default, int):
                result.integer_range = [IntegerRange(from_value=int(self.low),
                                                     to_value=int(self.high))]
            else:
                result.floating_point_range = [FloatingPointRange(from_value=float(self.low),
                                                                  to_value=float(self.high))]
        return result

    def problem(self, value: Any) -> str | None:
        """Why a value is refused; None if it is accepted."""
        if self.choices and value not in self.choices:
            return f'{self.name} is {value!r}, expected one of {", ".join(self.choices)}'
        if self.low is None or self.high is None:
            return None
        values = value if hasattr(value, '__len__') and not isinstance(value, str) else [value]
        for number in values:
            if not self.low <= number <= self.high:
                unit = f' {self.unit}' if self.unit else ''
                return (f'{self.name} is {number!r}{unit}, expected {self.low:g} to '
                        f'{self.high:g}{unit}')
        if hasattr(self.default, '__len__') and not self.each and (
                len(values) != len(self.default)):
            return f'{self.name} has {len(values)} entries, expected {len(self.default)}'
        return None


def specs_of(settings_class: type, changes: str = 'live', names: Mapping[str, str] | None = None,
             fixed: Collection[str] = ()) -> tuple[Spec, ...]:
    """
    Parameters for the fields of a settings dataclass (`gdmp_ros.util.settings.setting`).

    :param changes: when changes take effect
    :param names: parameter names of fields that have another one
    :param fixed: fields that change with the next ``configure`` only
    """
    names = names or {}
    return tuple(
        Spec(names.get(field, field), list(default) if isinstance(default, tuple) else default,
             known.description, known.unit, known.low, known.high, known.choices,
             'configure' if field in fixed else changes, known.each)
        for field, (default, known) in about(settings_class).items())


def settings_from(parameters: Any, settings_class: Callable[..., Settings],
                  names: Mapping[str, str] | None = None, **given: Any) -> Settings:
    """
    Make the settings from the parameters that `specs_of` declared for them.

    :param given: fields that are not parameters
    :raises ParameterError: if they contradict each other
    """
    values = {field: getattr(parameters, (names or {}).get(field, field))
              for field in about(settings_class)}
    return settings_class(**given, **{
        field: value if isinstance(value, (bool, int, float, str)) else tuple(value)
        for field, value in values.items()})


#: Parameters that rclpy declares with a publisher or subscription.
LATER = 'qos_overrides.'


class Parameters:
    """
    A node's parameters as attributes; changes are checked before they take effect.

    :ivar check: called with the proposed parameters while the node is configured; raises
        `ParameterError` if they contradict each other
    :ivar changed: called after changes, while the node is configured
    :ivar locked: whether the node is configured
    """

    def __init__(self, node: Node, specs: Sequence[Spec]):
        """
        Declare all of them.

        :raises ParameterError: if a value at start-up is out of range, or of no parameter: a limit
            with a wrong name would not be kept
        """
        self.check: Callable[[Any], object] = lambda _: None
        self.changed: Callable[[], None] = lambda: None
        self.locked = False
        self._node = node
        self._specs, self._unknown = {spec.name: spec for spec in specs}, ''
        for spec in specs:
            problem = spec.problem(self._declared(spec))
            if problem:
                raise ParameterError(problem)
        # rclpy gives them in no other way.
        for name in node._parameter_overrides:  # noqa: SLF001
            if not (node.has_parameter(name) or name.startswith(LATER)):
                raise ParameterError(self._no_parameter(name))
        node.add_pre_set_parameters_callback(self._known)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._after)

    def __getattr__(self, name: str) -> Any:
        if name.startswith('_') or name not in self._specs:
            raise AttributeError(name)
        return self._node.get_parameter(name).value

    def _declared(self, spec: Spec) -> Any:
        """Declare a parameter and return its value."""
        try:
            return self._node.declare_parameter(spec.name, spec.default, spec.descriptor()).value
        except ParameterException as error:  # rclpy checks types and ranges of scalars
            raise ParameterError(str(error)) from None

    def _no_parameter(self, name: str) -> str:
        near = difflib.get_close_matches(name, self._specs)
        hint = f'; similar: {", ".join(near)}' if near else ''
        return f'{name} is no parameter of this node{hint}'

    def _known(self, changes: list[Parameter]) -> list[Parameter]:
        """The changes; the present value of some parameter instead, if a name is unknown."""
        unknown = [change.name for change in changes if not self._node.has_parameter(change.name)]
        self._unknown = unknown[0] if unknown else ''
        # rclpy refuses unknown names without saying them; only `_check` can give the reason.
        return [self._node.get_parameter(next(iter(self._specs)))] if unknown else changes

    def _check(self, changes: Sequence[Parameter]) -> SetParametersResult:
        if self._unknown:
            return SetParametersResult(successful=False, reason=self._no_parameter(self._unknown))
        for change in changes:
            problem = self._problem(change)
            if problem:
                return SetParametersResult(successful=False, reason=problem)
        if self.locked:
            try:
                self.check(_Proposed(self, {change.name: change.value for change in changes}))
            except GdmpError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _problem(self, change: Parameter) -> str | None:
        spec = self._specs.get(change.name)
        if spec is None and change.name not in WITH_CONFIGURE:
            return None
        problem = None if spec is None else spec.problem(change.value)
        fixed = spec is None or spec.changes == 'configure'
        # Files that `ros2 param dump` wrote contain every parameter: equal values are accepted.
        if problem is None and self.locked and fixed and not self._is_present(change):
            problem = (f'{change.name} cannot change while the node is configured: clean it up, '
                       'set it, and configure it again')
        return problem

    def _is_present(self, change: Parameter) -> bool:
        present = self._node.get_parameter(change.name).value
        if hasattr(present, '__len__') and not isinstance(present, str):
            return list(present) == list(change.value)
        return bool(present == change.value)

    def _after(self, changes: Sequence[Parameter]) -> None:
        if self.locked and any(change.name in self._specs for change in changes):
            self.changed()


class _Proposed:
    """The parameters with some changes that are not in force yet."""

    def __init__(self, present: Parameters, changes: Mapping[str, Any]):
        self._present, self._changes = present, changes

    def __getattr__(self, name: str) -> Any:
        return self._changes[name] if name in self._changes else getattr(self._present, name)



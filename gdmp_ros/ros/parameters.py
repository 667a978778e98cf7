"""Parameters with a description, a unit and a range, declared from one table."""
from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from gdmp_ros.errors import GdmpError

#: When a changed parameter takes effect.
CHANGES = {'configure': 'read-only while the node is configured', 'live': 'changes at once',
           'motion': 'changes with the next motion'}


@dataclass(frozen=True)
class Spec:
    """
    One parameter.

    :ivar unit: empty where there is none
    :ivar low: smallest value, None without bound
    :ivar high: largest value
    :ivar choices: the strings allowed
    :ivar changes: when a change takes effect: with the next ``configure`` (until then the node is
        asked to be unconfigured), ``live``, or with the next ``motion``
    """

    name: str
    default: Any
    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    changes: str = 'configure'

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
        """Why a value is refused, None where it is not."""
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
        if hasattr(self.default, '__len__') and len(values) != len(self.default):
            return f'{self.name} has {len(values)} entries, expected {len(self.default)}'
        return None


class Parameters:
    """
    A node's parameters as attributes; changes are checked before they take effect.

    :ivar check: called with the parameters as they would be, while the node is configured; raises
        `ParameterError` where they contradict each other
    :ivar changed: called after changes, while the node is configured
    """

    def __init__(self, node: Node, specs: Sequence[Spec]):
        """Declare all of them."""
        self.check: Callable[[Any], object] = lambda _: None
        self.changed: Callable[[], None] = lambda: None
        self._node = node
        self._specs = {spec.name: spec for spec in specs}
        self.locked = False
        for spec in specs:
            value = node.declare_parameter(spec.name, spec.default, spec.descriptor()).value
            problem = spec.problem(value)
            if problem:
                raise ValueError(problem)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._after)

    def __getattr__(self, name: str) -> Any:
        if name.startswith('_') or name not in self._specs:
            raise AttributeError(name)
        return self._node.get_parameter(name).value

    def _check(self, changes: Sequence[Parameter]) -> SetParametersResult:
        for change in changes:
            spec = self._specs.get(change.name)
            if spec is None:
                continue
            problem = spec.problem(change.value)
            if problem is None and self.locked and spec.changes == 'configure':
                problem = (f'{change.name} cannot change while the node is configured: clean it '
                           'up, set it, and configure it again')
            if problem:
                return SetParametersResult(successful=False, reason=problem)
        if self.locked:
            try:
                self.check(_Proposed(self, {change.name: change.value for change in changes}))
            except GdmpError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after(self, changes: Sequence[Parameter]) -> None:
        if self.locked and any(change.name in self._specs for change in changes):
            self.changed()


class _Proposed:
    """Parameters as they would be after some changes."""

    def __init__(self, present: Parameters, changes: Mapping[str, Any]):
        self._present, self._changes = present, changes

    def __getattr__(self, name: str) -> Any:
        return self._changes[name] if name in self._changes else getattr(self._present, name)

"""
Every parameter of every node as text: ``config/*.yaml`` and ``docs/parameters.md``.

``python -m gdmp_ros.ros.parameter_tables`` in the folder of the project writes the files.
"""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import yaml

from gdmp_ros.ros import adapter
from gdmp_ros.ros.arm import parameters as arm_parameters
from gdmp_ros.ros.arm import servo_sim
from gdmp_ros.ros.arm.parameters import GRIPPER
from gdmp_ros.ros.parameters import CHANGES, Spec
from gdmp_ros.ros.recorder import node as take_recorder
from gdmp_ros.ros.server import node as server_parameters
from gdmp_ros.ros.visualizer import node as visualizer
from gdmp_ros.util.files import write_text

NODES: dict[str, tuple[str, Sequence[Spec]]] = {
    'trajectory_server': ('Trajectory server', server_parameters.SPECS),
    'panda_sim': ('Simulated arm', arm_parameters.SIMULATION),
    'franka_arm': ('Franka Research 3', arm_parameters.FRANKA),
    'franka_gripper': ('Hand of a Franka', GRIPPER),
    'position_arm': ('Arm that takes joint positions', arm_parameters.POSITION),
    'servo_sim': ('Simulated arm that takes joint positions', servo_sim.SPECS),
    'adapter': ('Adapter to other controllers', adapter.SPECS),
    'take_recorder': ('Recorder of takes', take_recorder.SPECS),
    'visualizer': ('Markers for RViz and Foxglove', visualizer.SPECS),
}
_WIDTH = 98
#: When a change takes effect, in a word (`CHANGES`).
_WHEN = {'configure': 'configure', 'live': 'at once', 'motion': 'motion'}


def bounds(spec: Spec) -> str:
    """Range of a parameter, or its choices; empty if there are none."""
    if spec.choices:
        return ', '.join(spec.choices)
    if spec.low is None or spec.high is None:
        return ''
    return f'{spec.low:g} to {spec.high:g}'


def yaml_text(node: str) -> str:
    """Configuration file of a node: every parameter with its default, unit and range."""
    title, specs = NODES[node]
    lines = [f'# {title}: every parameter with its default.', f'/**/{node}:', '  ros__parameters:']
    for spec in specs:
        unit = f' [{spec.unit}]' if spec.unit else ''
        words = '; '.join(filter(None, [spec.description + unit, bounds(spec)]))
        lines += _comment(words)
        value = yaml.safe_dump(spec.default, default_flow_style=True).removesuffix('...\n').strip()
        lines.append(f'    {spec.name}: {value}')
    return '\n'.join(lines) + '\n'


def _comment(words: str) -> list[str]:
    lines, line = [], '    #'
    for word in words.split():
        if len(line) + 1 + len(word) > _WIDTH:
            lines.append(line)
            line = '    #'
        line += f' {word}'
    return [*lines, line]


def markdown() -> str:
    """Page with a table for each node."""
    lines = ['# Parameters', '', 'All parameters of all nodes, for a quick look-up. Generated '
             'from the source. `ros2 param set` says why a change is refused; a refused change '
             'has no effect.', '',
             'The last column says when a change takes effect:', '',
             *(f'- **{_WHEN[key]}**: {text}' for key, text in CHANGES.items()), '']
    for node, (title, specs) in NODES.items():
        lines += [f'## `{node}`: {title.lower()}', '',
                  '| parameter | description | default | range | change |',
                  '|---|---|---|---|---|']
        lines += [f'| `{spec.name}` | {spec.description} | `{_short(spec.default)}` {spec.unit} | '
                  f'{bounds(spec)} | {_WHEN[spec.changes]} |' for spec in specs]
        lines.append('')
    return '\n'.join(lines)


def _short(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value)


def files() -> dict[Path, str]:
    """All generated files, relative to the project, with their text."""
    result = {Path('config') / f'{node}.yaml': yaml_text(node) for node in NODES}
    return {**result, Path('docs/parameters.md'): markdown()}


if __name__ == '__main__':
    for path, text in files().items():
        write_text(path, text)
        print(f'wrote {path}')

"""Values of `ros2 param set` in the documentation have the type that the command line reads."""
from pathlib import Path
import re

import pytest
import yaml

from gdmp_ros.ros.parameter_tables import NODES

ROOT = Path(__file__).parents[2]
LINES = [(path.name, *match) for path in (ROOT / 'README.md', *(ROOT / 'docs').glob('*.md'))
         for match in re.findall(r'ros2 param set (?:--\S+ (?:\d+ )?)*/(\S+) (\S+) (\S+)',
                                 path.read_text())]


def test_there_are_such_lines():
    assert len(LINES) >= 3


@pytest.mark.parametrize('page, node, name, value', LINES)
def test_a_value_has_the_type_of_the_parameter(page, node, name, value):
    """YAML 1.1: 1e6 is a text there."""
    default = next(spec.default for spec in NODES[node][1] if spec.name == name)
    assert type(yaml.safe_load(value)) is type(default), (page, value)

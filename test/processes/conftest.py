"""Nodes as processes, over real DDS."""
import pytest

from test.ros.nodes import open_processes


@pytest.fixture
def nodes(tmp_path, skill_file):
    """A testbed of this test, without nodes."""
    with open_processes(tmp_path / 'nodes', skill_file) as made:
        yield made

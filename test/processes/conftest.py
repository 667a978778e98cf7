"""Nodes as processes, over real DDS."""
import pytest

from gdmp_ros.util.dds_network import Domain
from test.ros.nodes import open_processes


@pytest.fixture
def nodes(tmp_path, skill_file):
    """A testbed of this test, without nodes."""
    with open_processes(tmp_path / 'nodes', skill_file) as made:
        yield made


@pytest.fixture
def domain(monkeypatch):
    """A domain of DDS without other participants."""
    with Domain() as claimed:
        for name, value in claimed.environment().items():
            monkeypatch.setenv(name, value)
        yield

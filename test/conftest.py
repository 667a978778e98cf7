"""What every test may ask for."""
import numpy as np
import pytest


@pytest.fixture
def rng():
    return np.random.default_rng(7)


def pytest_collection_modifyitems(items):
    """
    Feed damaged messages last.

    Decoding one, the middleware sets aside what it says it holds, gigabytes of addresses that are
    never used and not always given back; after some of them no process can be started by a fork.
    """
    items.sort(key=lambda item: item.path.stem == 'test_entrances' and 'named_errors' in item.name)

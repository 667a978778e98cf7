"""A bounded share of `make fuzz`: every entrance with bytes near valid ones, and with any."""
import resource

from hypothesis import given, settings
from hypothesis import strategies as st
import psutil
import pytest

from test.fuzz.entrances import ENTRANCES

#: Address space for one entrance [bytes]: a message may say that it holds gigabytes.
SPACE = 2 << 30
_made = {}


def entrance(name):
    if name not in _made:
        _made[name] = ENTRANCES[name]()
    return _made[name]


@st.composite
def damaged(draw, seeds):
    """A valid input with a few bytes changed, cut out or put in; or anything."""
    data = bytearray(draw(st.sampled_from(seeds)))
    for _ in range(draw(st.integers(0, 4))):
        at = draw(st.integers(0, len(data)))
        part = draw(st.binary(max_size=12))
        data[at:at + draw(st.integers(0, 12))] = part
    return draw(st.one_of(st.just(bytes(data)), st.just(bytes(data[:len(data) // 2])),
                          st.binary(max_size=200)))


@pytest.fixture
def little_space():
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (psutil.Process().memory_info().vms + SPACE,
                                            before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.parametrize('name', ENTRANCES)
def test_only_named_errors_come_out_and_the_next_tick_works(name, little_space):
    made = entrance(name)
    for seed in made.seeds:
        made.feed(seed)

    @settings(max_examples=60)
    @given(damaged(made.seeds))
    def feed(data):
        made.feed(data)
    feed()

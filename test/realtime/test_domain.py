"""Which machines reach the nodes by which transport, with and without a choice of the user."""
import pytest

from gdmp_ros.util import dds_network

RANGE, PROFILE = dds_network.RANGE, 'FASTRTPS_DEFAULT_PROFILES_FILE'


@pytest.mark.parametrize('chosen, given', [
    ({}, {RANGE: 'SYSTEM_DEFAULT', PROFILE: str(dds_network.PROFILE)}),
    # LOCALHOST alone would add shared memory.
    ({RANGE: 'LOCALHOST'}, {RANGE: 'SYSTEM_DEFAULT', PROFILE: str(dds_network.PROFILE)}),
    ({'ROS_LOCALHOST_ONLY': '1'}, {RANGE: 'SYSTEM_DEFAULT', 'ROS_LOCALHOST_ONLY': '0',
                                   PROFILE: str(dds_network.PROFILE)}),
    ({RANGE: 'SUBNET'}, {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}),
    ({'ROS_STATIC_PEERS': '10.0.0.2'}, {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}),
    ({RANGE: 'LOCALHOST', 'ROS_STATIC_PEERS': '10.0.0.2'},
     {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}),
    ({'FASTDDS_BUILTIN_TRANSPORTS': 'SHM'}, {}),
    ({PROFILE: '/mine.xml', RANGE: 'SUBNET'}, {}),
    ({'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}, {RANGE: 'LOCALHOST'}),
    ({'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp', RANGE: 'SUBNET'}, {}),
])
def test_a_choice_of_the_user_is_kept(monkeypatch, chosen, given):
    for name in (*dds_network.REACH, *dds_network.TRANSPORT, 'RMW_IMPLEMENTATION'):
        monkeypatch.delenv(name, raising=False)
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    assert dds_network.default_environment() == given
    # The restriction is reported unless the user has made a choice.
    asked = any(name in chosen for name in (*dds_network.REACH, *dds_network.TRANSPORT))
    assert bool(dds_network.unasked_restriction()) == (not asked)

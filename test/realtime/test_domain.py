"""Who can reach the nodes, and over what, where the user has chosen and where not."""
import pytest

from gdmp_ros.util import dds_network as domain

PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


@pytest.mark.parametrize('chosen, given', [
    ({}, {domain.RANGE: 'SYSTEM_DEFAULT', PROFILE: str(domain.PROFILE)}),
    # The same in other words: and no shared memory either.
    ({domain.RANGE: 'LOCALHOST'}, {domain.RANGE: 'SYSTEM_DEFAULT', PROFILE: str(domain.PROFILE)}),
    ({'ROS_LOCALHOST_ONLY': '1'}, {domain.RANGE: 'SYSTEM_DEFAULT', 'ROS_LOCALHOST_ONLY': '0',
                                   PROFILE: str(domain.PROFILE)}),
    ({domain.RANGE: 'SUBNET'}, {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}),
    ({'ROS_STATIC_PEERS': '10.0.0.2'}, {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}),
    ({domain.RANGE: 'LOCALHOST', 'ROS_STATIC_PEERS': '10.0.0.2'},
     {'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4'}),
    ({'FASTDDS_BUILTIN_TRANSPORTS': 'SHM'}, {}),
    ({PROFILE: '/mine.xml', domain.RANGE: 'SUBNET'}, {}),
    ({'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp'}, {domain.RANGE: 'LOCALHOST'}),
    ({'RMW_IMPLEMENTATION': 'rmw_cyclonedds_cpp', domain.RANGE: 'SUBNET'}, {}),
])
def test_what_the_user_has_chosen_stays(monkeypatch, chosen, given):
    for name in (*domain.CHOSEN, 'RMW_IMPLEMENTATION'):
        monkeypatch.delenv(name, raising=False)
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    assert domain.network() == given

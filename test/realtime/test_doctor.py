"""The doctor runs all checks; a finding that is not good says what to change."""
import os
from types import SimpleNamespace

from gdmp_ros.realtime import doctor


def test_every_finding_that_is_not_good_has_advice():
    findings = doctor.examine(0.3)
    assert len(findings) == len(doctor.CHECKS) + 1
    assert len({one.subject for one in findings}) == len(findings)
    for one in findings:
        assert one.found and (one.level == doctor.GOOD) == (one.advice == '')
    loop = findings[-1]
    assert 'lateness p50' in loop.found and 0.0 < float(loop.found.split(' Hz')[0]) < 1100.0


def test_a_right_that_is_not_granted_is_bad(monkeypatch):
    def refuse(*_):
        raise PermissionError
    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    found = doctor._fifo()
    assert found.level == doctor.BAD and 'rtprio' in found.advice


def test_a_full_disk_is_bad_and_a_small_one_fair(monkeypatch):
    for free, level in ((1e8, doctor.BAD), (1e9, doctor.FAIR), (1e10, doctor.GOOD)):
        monkeypatch.setattr(doctor.shutil, 'disk_usage', lambda _, free=free: SimpleNamespace(
            free=free))
        assert doctor._disk().level == level


def test_files_left_by_dds_are_found_and_a_chosen_transport_is_respected(monkeypatch):
    monkeypatch.setattr(doctor.Path, 'iterdir', lambda _: iter(
        [doctor.Path('/dev/shm/fastrtps_port7411'), doctor.Path('/dev/shm/other')]))
    found = doctor._shared_memory()
    assert found.level == doctor.FAIR and found.found.startswith('1 files')
    for name in (*doctor.REACH, *doctor.TRANSPORT):
        monkeypatch.delenv(name, raising=False)
    assert doctor._reach().level == doctor.GOOD
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    assert doctor._reach().found == 'ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET, over UDPv4'
    monkeypatch.setenv('FASTDDS_DEFAULT_PROFILES_FILE', '/mine.xml')
    assert doctor._reach().level == doctor.FAIR
    monkeypatch.setenv('FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4')
    assert doctor._reach().level == doctor.GOOD

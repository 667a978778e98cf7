"""Modules that are missing or broken are named in one line."""
import sys

import pytest

from gdmp_ros import DataError
from gdmp_ros.util.optional_imports import extra, optional_import, ROS


def test_a_missing_module_is_named_with_its_origin():
    with pytest.raises(DataError, match=r"^no_such_module is missing, it comes with pip install "
                       r"'\.\[sim\]' in the folder of gdmp_ros$"), optional_import(extra('sim')):
        import no_such_module  # noqa: F401


def test_a_broken_module_is_named_with_the_reason():
    with pytest.raises(DataError, match='rclpy cannot be used .*librcl.so'), optional_import(ROS):
        raise ImportError('librcl.so: cannot open shared object file', name='rclpy')


def test_an_extra_is_named_although_the_file_is_for_ros(monkeypatch):
    monkeypatch.setitem(sys.modules, 'psutil', None)
    with (pytest.raises(DataError, match=r'psutil is missing, it comes with .*\.\[faults\]'),
          optional_import(ROS)):
        import psutil  # noqa: F401

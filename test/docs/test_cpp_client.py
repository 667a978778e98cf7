"""The client in C++: its checks are compiled and tried; the rest needs rclcpp."""
from pathlib import Path
import shutil
import subprocess
from xml.etree import ElementTree

import pytest

FOLDER = Path(__file__).parents[2] / 'examples' / 'cpp_client'
PROGRAM = r"""
#include <cstdio>
#include <limits>
#include "gdmp_client/guard.hpp"
using namespace gdmp_client;

int main()
{
  Reference good;
  good.frame = "panda_link0"; good.stamp = 10.0; good.sequence = 1; good.mode = Mode::Streaming;
  good.pose = {0.4, 0.0, 0.3, 0.0, 1.0, 0.0, 0.0};
  good.stiffness.fill(0.0);
  auto told = [&](Guard & guard, Reference one, double now) {
    const auto text = guard.check(one, now);
    std::printf("%s\n", text.empty() ? "accepted" : text.c_str());
  };
  Guard guard{Limits{}};
  told(guard, good, 10.01);
  Reference one = good; one.sequence = 2; one.frame = "world"; told(guard, one, 10.01);
  one = good; one.sequence = 2; one.pose[1] = std::numeric_limits<double>::quiet_NaN();
  told(guard, one, 10.01);
  one = good; one.sequence = 2; one.pose[4] = 0.5; told(guard, one, 10.01);
  one = good; one.sequence = 2; one.stiffness[0] = 1e6; told(guard, one, 10.01);
  one = good; one.sequence = 2; told(guard, one, 11.0);
  told(guard, good, 10.01);
  one = good; one.sequence = 2; one.pose[0] = 0.6; told(guard, one, 10.01);
  one = good; one.sequence = 2; one.mode = Mode::Ended; told(guard, one, 10.01);
  one = good; one.sequence = 1; one.pose[0] = 0.6; told(guard, one, 10.01);
}
"""


@pytest.mark.skipif(shutil.which('g++') is None, reason='no C++ compiler')
def test_the_checks_of_the_client_accept_and_refuse(tmp_path):
    (tmp_path / 'try.cpp').write_text(PROGRAM)
    subprocess.run(['g++', '-std=c++17', '-Wall', '-Wextra', '-Wpedantic', '-Werror',
                    '-I', str(FOLDER / 'include'), 'try.cpp', '-o', 'try'], cwd=tmp_path,
                   check=True)
    said = subprocess.run(['./try'], cwd=tmp_path, check=True, capture_output=True, text=True)
    assert said.stdout.splitlines() == [
        'accepted', 'frame world, expected panda_link0', 'pose is not finite',
        'not a unit quaternion', 'stiffness out of range', 'stamp of another time',
        'sequence does not increase', 'jump of the pose', 'accepted', 'accepted']


def test_the_package_names_what_it_uses():
    package = ElementTree.parse(FOLDER / 'package.xml')
    needed = {one.text for one in package.findall('depend')}
    cmake, source = ((FOLDER / name).read_text() for name in ('CMakeLists.txt', 'src/follow.cpp'))
    for name in needed:
        assert f'find_package({name} REQUIRED)' in cmake and f'{name}/' in source
    assert 'trajectory_server/reference' in source

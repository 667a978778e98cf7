"""The command line as a user has it: a process."""
import os
import subprocess
import sys

GDMP = [sys.executable, '-m', 'gdmp_ros.cli.start']


def gdmp(*words, given=None, cwd=None, timeout=280, **environment):
    """Run ``gdmp`` to its end; ``given`` is typed, the environment has these variables too."""
    return subprocess.run([*GDMP, *map(str, words)], input=given, capture_output=True, text=True,
                          cwd=cwd, timeout=timeout, env={**os.environ, **environment})

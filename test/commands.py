"""The command line as a user has it: a process."""
import os
import subprocess
import sys


def gdmp(*words, given=None, cwd=None, **environment):
    """Run ``gdmp`` to its end; ``given`` is typed, the environment has these variables too."""
    return subprocess.run([sys.executable, '-m', 'gdmp_ros.cli.main', *map(str, words)],
                          input=given, capture_output=True, text=True, cwd=cwd, timeout=280,
                          env={**os.environ, **environment})

"""Progress of the compilation of kernels."""
import time

from gdmp_ros.kernels import kernel
from gdmp_ros.util import compile_progress
from gdmp_ros.util.compile_progress import compilation_reported


def test_compilation_is_reported_and_a_compiled_kernel_is_not(tmp_path, monkeypatch):
    monkeypatch.setenv('GDMP_CACHE', str(tmp_path))

    @kernel
    def incremented(number):
        return number + 1.0
    lines = []
    with compilation_reported(lines.append):
        assert incremented(1.0) == 2.0
    assert lines[0].startswith('compiling the kernels')
    assert lines[-1] == '1 kernels compiled in 0 s'
    lines.clear()
    with compilation_reported(lines.append):
        assert incremented(2.0) == 3.0
    assert lines == []


def test_a_long_compilation_is_reported_again_and_again(monkeypatch):
    monkeypatch.setattr(compile_progress, 'EVERY_S', 0.05)
    listeners = []

    class Observed:
        def __init__(self, *callbacks):
            listeners.append(callbacks)

        def __enter__(self):
            return None

        def __exit__(self, *_):
            return None
    monkeypatch.setattr(compile_progress, 'on_compile', Observed)
    lines = []
    with compilation_reported(lines.append):
        started, finished = listeners[0]
        started('manifolds.spd._exp')
        time.sleep(0.3)
        finished()
        time.sleep(0.2)
    slow = [line for line in lines if 'manifolds.spd._exp' in line]
    # Silence while nothing is compiled.
    assert 2 <= len(slow) <= 7 and len(lines) == len(slow) + 2

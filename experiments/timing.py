"""How benchmarks are measured: settings, medians, one core, skills to measure."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
import gc
from importlib.metadata import PackageNotFoundError, version
import os
from pathlib import Path
import platform
import time

import numpy as np

from experiments.baselines.baseline import Baseline
from gdmp_ros import __version__
from gdmp_ros.data import lasa
from gdmp_ros.dmp.demonstration import Demonstration
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.manifolds.euclidean import Euclidean
from gdmp_ros.manifolds.manifold import Manifold
from gdmp_ros.manifolds.product import Product
from gdmp_ros.manifolds.quaternion import UnitQuaternion
from gdmp_ros.manifolds.spd import SymmetricPositiveDefinite
from gdmp_ros.util.profiles import minimum_jerk

POSE = Product(Euclidean(3), UnitQuaternion(), names=('position', 'orientation'))


@dataclass(frozen=True)
class TimingSettings:
    """
    Options of the benchmarks.

    :ivar repetitions: of every timing; the median is reported
    :ivar seconds: duration of `stream`
    :ivar jobs: processes for `accuracy`
    :ivar dask: address of a Dask scheduler to use instead
    :ivar resume: file with finished parts of `accuracy`
    :ivar robottasks: folder with the data for `takes`
    :ivar frames: folder with the data for `generalise`
    :ivar situations: of each task of `generalise` on the simulated arm; 0: none
    """

    repetitions: int = 9
    seconds: float = 60.0
    jobs: int = 1
    dask: str | None = None
    resume: Path | None = None
    classes: tuple[str, ...] = field(default_factory=lambda: lasa.CLASSES)
    n_basis: int = 60
    robottasks: Path | None = None
    frames: Path | None = None
    situations: int = 0


def pose_with_stiffness(size: int) -> Product:
    """R³ × S³ × SPD(size)."""
    return Product(Euclidean(3), UnitQuaternion(), SymmetricPositiveDefinite(size),
                   names=('position', 'orientation', 'stiffness'))


def demonstration(manifold: Manifold, duration: float, seed: int = 0,
                  samples: int = 1000) -> Demonstration:
    """A smooth motion in all directions, at rest at both ends."""
    rng = np.random.default_rng(seed)
    base = manifold.random_point(rng)
    first, second = manifold.random_tangent(base, rng), manifold.random_tangent(base, rng)
    first *= 0.6 / manifold.norm(base, first)
    second *= 0.2 / manifold.norm(base, second)
    t = np.linspace(0.0, 1.0, samples)
    points = [manifold.exp(base, b * first + np.sin(2.0 * np.pi * b) * second)
              for b in minimum_jerk(t)]
    return Demonstration(duration * t, np.array(points), manifold)


def skill(manifold: Manifold, duration: float, n_basis: int = 50, seed: int = 0,
          connection: str = 'parallel') -> Skill:
    """Skill learned from `demonstration`."""
    return Skill.learn(demonstration(manifold, duration, seed), n_basis, connection=connection)


@contextmanager
def one_core() -> Iterator[None]:
    """Use one core, without garbage collection."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {max(before)})
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        os.sched_setaffinity(0, before)


def median_time(prepare: Callable[[], Callable[[], object]], calls: int,
                repetitions: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """
    Median over ``repetitions`` of the mean time of a call [s].

    :param prepare: returns the call, once for each repetition
    :param clock: `time.thread_time` does not count other load of the machine, but also not the
        work of other threads for the call
    """
    times = []
    for _ in range(repetitions):
        call = prepare()
        begun = clock()
        for _ in range(calls):
            call()
        times.append((clock() - begun) / calls)
    return float(np.median(times))


def step_time(method: Baseline, cycles: int = 500) -> float:
    """Median time of a cycle of 1 ms, with the projection that a robot needs [s]."""
    def prepare() -> Callable[[], object]:
        method.reset(1e-3)
        return lambda: method.output(method.step())
    return median_time(prepare, cycles, 7)


#: Libraries that are measured for comparison.
PEERS = ('movement_primitives', 'pymanopt', 'cma')


def environment() -> dict[str, object]:
    """Versions, also of the libraries that are measured for comparison, and machine."""
    found = {}
    for peer in PEERS:
        with suppress(PackageNotFoundError):
            found[peer] = version(peer)
    return {**found, 'gdmp_ros': __version__, 'python': platform.python_version(),
            'numpy': np.__version__, 'numba': version('numba'), 'machine': platform.machine(),
            'kernel': platform.release(), 'cpus': os.cpu_count()}

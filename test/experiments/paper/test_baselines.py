"""The compared methods, each on the spaces that its publication defines it for."""
import numpy as np
import pytest

from experiments import timing
from experiments.baselines.classical import Classical
from experiments.baselines.literal import LiteralScheme
from experiments.baselines.log_error import LogError, LogErrorShorter
from experiments.baselines.methods import METHODS
from experiments.baselines.ours import Ours
from experiments.baselines.quaternion import AbuDakkaQuaternion, UdeQuaternion
from experiments.baselines.rotation import UdeRotation
from experiments.baselines.transported import TransportedAlong, TransportedToStart
from experiments.paper.fig4 import shown as quaternion_example
from experiments.paper.table1 import cell, COLUMNS, ROWS
from experiments.paper.theorem1 import spring_skill
from gdmp_ros.dmp import Demonstration
from gdmp_ros.errors import ParameterError
from gdmp_ros.manifolds import SpecialOrthogonal, Sphere, SymmetricPositiveDefinite, UnitQuaternion

S3, SO3, SPD3 = UnitQuaternion(), SpecialOrthogonal(3), SymmetricPositiveDefinite(3)
DEFINED_ON = [(Classical, S3), (UdeQuaternion, S3), (AbuDakkaQuaternion, S3), (LogError, S3),
              (UdeRotation, SO3), (TransportedToStart, SPD3), (TransportedAlong, SPD3),
              (LiteralScheme, SPD3), (Ours, S3), (Ours, SPD3)]


def relative_error(method, shown):
    points, _ = method.rollout(len(shown.times) - 1)
    return shown.manifold.factor_distances(points, shown.flat_points).mean() / shown.span()


@pytest.mark.parametrize('kind, manifold', DEFINED_ON,
                         ids=lambda x: getattr(x, '__name__', str(x)))
def test_each_method_follows_and_reaches_a_switched_goal(kind, manifold):
    shown = timing.demonstration(manifold, 2.0, samples=500)
    method = kind(shown)
    assert relative_error(method, shown) < 1e-4
    goal = manifold.geodesic(shown.points[-1], shown.points[200], 0.3)
    points, _ = method.rollout(1250, goal, 250)
    left = manifold.distance(points[-1].reshape(manifold.point_shape), goal)
    assert left < 0.02 * manifold.distance(shown.points[-1], goal)


@pytest.mark.parametrize('kind', METHODS, ids=lambda k: k.name)
def test_methods_refuse_spaces_on_which_they_are_not_defined(kind):
    shown = timing.demonstration(Sphere(2), 1.0, samples=50)
    if kind.handles(shown):
        assert relative_error(kind(shown, 20), shown) < 1e-2
    else:
        with pytest.raises(ParameterError, match='is not defined on'):
            kind(shown)


def test_explicit_transport_moves_as_the_parallel_frame_does(rng):
    """A motion without forcing, with a lateral start velocity: `published` takes another path."""
    start = SPD3.random_point(rng)
    velocity = SPD3.random_tangent(start, rng)
    velocity *= 20.0 / SPD3.norm(start, velocity)
    offset = SPD3.random_tangent(start, rng)
    goal = SPD3.exp(start, 1.5 / SPD3.norm(start, offset) * offset)
    times = np.linspace(0.0, 1.0, 4001)
    shown = Demonstration(times, np.array([SPD3.geodesic(start, goal, t) for t in times]), SPD3)
    along = TransportedAlong(shown, 10)
    along._weights[:], along._first_error[:] = 0.0, 0.0
    along._begin = velocity.copy()
    path, _ = along.rollout(4000)
    paths = {c: spring_skill(SPD3, start, goal, velocity, 60.0, c).rollout().sample(times).points
             for c in ('parallel', 'published')}
    away = {c: SPD3.factor_distances(points.reshape(4001, -1), path).max()
            for c, points in paths.items()}
    assert away['parallel'] < 0.01 * shown.span()
    assert away['published'] > 3.0 * away['parallel']


def test_a_goal_switched_at_the_very_start_is_reached_too():
    shown = timing.demonstration(S3, 2.0, samples=500)
    method = LogError(shown)
    goal = S3.geodesic(shown.points[-1], shown.points[200], 0.3)
    for dt in (method.dt, 1e-3):
        points, _ = method.rollout(round(4.0 / dt), goal, 0, dt)
        assert S3.distance(points[-1], goal) < 1e-3
        assert S3.distance(points[0], points[1]) < 1e-3


def test_backward_differences_cost_accuracy():
    shown = timing.demonstration(S3, 2.0, samples=300)
    matched, backward = (relative_error(LogError(shown, differences=d), shown)
                         for d in ('matched', 'backward'))
    assert backward > 5.0 * matched


def test_only_the_shorter_logarithm_makes_the_log_error_primitive_jump():
    """The motion of [GDMP] Fig. 4 begins 190.7 degrees from its goal."""
    shown = quaternion_example()
    steps = [max(S3.distance(a, b) for a, b in zip(path, path[1:])) for path in (
        kind(shown).rollout(len(shown.times) - 1)[0] for kind in (LogError, LogErrorShorter))]
    assert steps[1] > 5.0 * steps[0]


def test_the_classical_primitive_leaves_the_sphere_without_projection():
    shown = timing.demonstration(S3, 2.0, samples=500)
    points, raw = Classical(shown).rollout(499)
    norms = np.linalg.norm(raw, axis=1)
    assert np.abs(norms - 1.0).max() > 1e-7
    assert np.abs(np.linalg.norm(points, axis=1) - 1.0).max() < 1e-12


@pytest.mark.parametrize('column', COLUMNS)
@pytest.mark.parametrize('row', ROWS)
def test_table_1_cell_by_cell(row, column):
    handled, error, off = cell(row, column)
    if column in ROWS[row][1]:
        assert handled and error < 1e-3 and off < 1e-9
    elif (row, column) == ('[4, 7] Ijspeert', 'SPD(m)'):
        assert handled  # on this trajectory only: see the next test
    else:
        assert not handled


def test_nothing_keeps_the_classical_primitive_in_the_cone():
    """A stiffness that decreases by 80 %, with a goal of 30 %."""
    t = np.linspace(0.0, 1.0, 500)
    dip = np.array([np.diag([1.0 - 0.8 * np.sin(np.pi * u) ** 2, 1.0]) for u in t])
    shown, goal = Demonstration(2.0 * t, dip, SymmetricPositiveDefinite(2)), np.diag([0.3, 1.0])
    _, raw = Classical(shown).rollout(600, goal, 20)
    assert np.linalg.eigvalsh(raw.reshape(-1, 2, 2)).min() < 0.0
    points, _ = Ours(shown).rollout(600, goal, 20)
    assert np.linalg.eigvalsh(points.reshape(-1, 2, 2)).min() > 0.0

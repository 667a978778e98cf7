"""Invalid values of every public argument: a named error, or a finite result."""
import warnings

import numpy as np
import pytest

from gdmp_ros import Coupling, Demonstration, Euclidean, Product, Rollout, Skill, UnitQuaternion
from gdmp_ros.dmp.options import Options
from gdmp_ros.dmp.primitive import Gains, GripperEvent
from gdmp_ros.dmp.sequence import HoldStep, MotionStep, SequenceRollout, SkillSequence
from gdmp_ros.errors import GdmpError
from gdmp_ros.util.profiles import minimum_jerk

TOOL = Product(Euclidean(3), UnitQuaternion(), names=['position', 'orientation'])
VALUES = {
    'zero': 0, 'one': 1, 'minus one': -1, 'inf': np.inf, '-inf': -np.inf, 'nan': np.nan,
    'huge': 1e300, 'tiny': 5e-324, 'huge integer': 10 ** 300, 'int64': np.int64(3),
    'float32': np.float32(0.5), 'array of one': np.array([0.5]), 'zeros': np.zeros(7),
    'ones': np.ones(7), 'nans': np.full(7, np.nan), 'infs': np.full(7, np.inf),
    'huge point': np.full(7, 1e300), 'two numbers': [0.0, 0.0], 'minus': [-1.0, -1.0],
    'two infs': [np.inf, np.inf], 'matrix': np.zeros((7, 7)), 'empty': [], 'nothing': None,
    'text': 'text', 'nested': [[1.0], [1.0, 2.0]], 'boolean': True, 'complex': 1j,
    'pair': [(0.5, np.zeros(7))], 'pair of nan': [(np.nan, np.ones(7))], 'mapping': {'a': 1.0},
    'far point': np.array([1e200, 0, 0, 1.0, 0, 0, 0]), 'norm 2': np.r_[np.zeros(3), 2.0, 0, 0, 0]}
#: What no number is wanted for is no list, and a loop in real time does not ask for a type.
WRONG_TYPE = {'through', 'condition', 'through points', 'advance', 'learn fit', 'learn end'}


def takes():
    result, times = [], np.linspace(0.0, 1.0, 101)
    for k in range(4):
        points = np.zeros((101, 7))
        points[:, :3] = np.outer(minimum_jerk(times), [0.1 + 0.01 * k, -0.2, 0.05 * k])
        angle = (0.3 + 0.05 * k) * minimum_jerk(times)
        points[:, 3], points[:, 4] = np.cos(angle), np.sin(angle)
        result.append(Demonstration(times, points, TOOL))
    return result


TAKES = takes()
SKILL = Skill.learn(TAKES, 10)
CONTEXTS = Skill.learn(TAKES, 10, contexts={'size': [0.0, 1.0, 2.0, 4.0]})
_TURNS = np.linspace(0.0, 3.0, 301)
CYCLE = Skill.learn_rhythmic(Demonstration(_TURNS, np.column_stack([
    0.1 * np.cos(2 * np.pi * _TURNS), 0.1 * np.sin(2 * np.pi * _TURNS), 0.0 * _TURNS]),
    Euclidean(3)))
PAIR = Skill.joined(SKILL, SKILL, ('left', 'right'))


def moved(change):
    """A roll-out that has been changed, and goes on."""
    rollout = Rollout(SKILL)
    rollout.advance(0.2)
    before = rollout.memory.copy()
    try:
        change(rollout)
    except GdmpError:
        np.testing.assert_array_equal(rollout.memory, before)
        raise
    return rollout.sample(rollout.motion.scalars.time + np.linspace(0.0, 2.0, 20)).points


def whole(skill):
    return Rollout(skill).sample(np.linspace(0.0, min(2.0 * skill.duration, 5.0), 20)).points


def rolled(**arguments):
    return Rollout(SKILL, **arguments).sample(np.linspace(0.0, 2.0, 20)).points


def sequence(*steps, **arguments):
    rollout = SequenceRollout(SkillSequence([MotionStep('a', SKILL), *steps]), **arguments)
    return [rollout.advance(0.5).point for _ in range(4)]


CALLS = {
    **{f'rollout {name}': lambda v, name=name: rolled(**{name: v})
       for name in ('start', 'goal', 'duration', 'velocity', 'final_velocity', 'frame')},
    'rollout acceleration': lambda v: rolled(velocity=np.zeros(6), acceleration=v),
    **{f'option {name}': lambda v, name=name: moved(lambda _: rolled(**{name: v}))
       for name in vars(Options())},
    'goal speed, two switches': lambda v: switched_twice(v),
    'error weights': lambda v: observed(v),
    'advance': lambda v: moved(lambda r: r.advance(v)),
    'sample': lambda v: moved(lambda r: r.sample(v)),
    'retarget': lambda v: moved(lambda r: r.retarget(v)),
    'retarget velocity': lambda v: moved(lambda r: r.retarget(SKILL.goal, v)),
    'observe': lambda v: moved(lambda r: r.observe(v)),
    'set_speed': lambda v: moved(lambda r: r.set_speed(v)),
    'set_amplitude': lambda v: Rollout(CYCLE).set_amplitude(v),
    'set_frequency': lambda v: Rollout(CYCLE).set_frequency(v),
    'begin': lambda v: moved(lambda r: r.begin(v)),
    'begin speed': lambda v: moved(lambda r: r.begin(speed=v)),
    **{f'obstacles {name}': lambda v, name=name: moved(
        lambda r: r.set_obstacles(**{'positions': [[0.0, 0.0, 0.1]], name: v}))
       for name in ('positions', 'gain', 'reach', 'bound')},
    'reproduce': lambda v: SKILL.reproduce(v).points,
    'between start': lambda v: whole(SKILL.between(start=v)),
    'between goal': lambda v: whole(SKILL.between(goal=v)),
    'through': lambda v: whole(SKILL.through(v)),
    'through point': lambda v: whole(SKILL.through([(0.5, v)])),
    'through progress': lambda v: whole(SKILL.through([(v, SKILL.start)])),
    'condition': lambda v: whole(SKILL.distribution.condition(v)),
    'condition point': lambda v: whole(SKILL.distribution.condition([(0.5, v)])),
    'condition progress': lambda v: whole(SKILL.distribution.condition([(v, SKILL.start)])),
    'mean': lambda v: SKILL.distribution.mean(v),
    'covariance': lambda v: SKILL.distribution.covariance(v),
    'context': lambda v: whole(CONTEXTS.in_context({'size': v})),
    'contexts': lambda v: whole(Skill.learn(TAKES, 10, contexts={'size': v})),
    'coupling relation': lambda v: whole(PAIR.coupled(Coupling(
        'relative', 'left_position', 'right_position', v))),
    'coupling rate': lambda v: whole(PAIR.coupled(Coupling(
        'relative', 'left_position', 'right_position', (0.0, 0.0, 0.0), rate=v))),
    'gains': lambda v: Gains(v), 'phase gain': lambda v: Gains(60.0, v),
    'goal gain': lambda v: Gains(60.0, 4.6, v),
    'event': lambda v: SKILL.with_events([GripperEvent(v, 0.0, 0.0, 0.1)]),
    'event width': lambda v: SKILL.with_events([GripperEvent(0.5, v, 0.0, 0.1)]),
    **{f'learn {name}': lambda v, name=name: whole(Skill.learn(TAKES[0], **{name: v}))
       for name in ('n_basis', 'alpha_z', 'alpha_x', 'alpha_g', 'tolerance', 'smoothing',
                    'regularization', 'fit', 'end', 'demonstration_weights')},
    **{f'cycle {name}': lambda v, name=name: whole(Skill.learn_rhythmic(Demonstration(
        _TURNS, np.column_stack([np.cos(6.3 * _TURNS), np.sin(6.3 * _TURNS)]), Euclidean(2)),
        **{name: v})) for name in ('period', 'n_basis', 'alpha_z', 'alpha_g', 'tolerance')},
    'times': lambda v: Demonstration(v, TAKES[0].points, TOOL).points,
    'points': lambda v: Demonstration(TAKES[0].times, v, TOOL).points,
    'smoothed': lambda v: TAKES[0].smoothed(v).points,
    'hold': lambda v: sequence(HoldStep('b', seconds=v)),
    'step goal': lambda v: sequence(MotionStep('b', SKILL, goal=v)),
    'step duration': lambda v: sequence(MotionStep('b', SKILL, duration=v)),
    'step blend': lambda v: sequence(MotionStep('b', SKILL, blend=v)),
    'sequence start': lambda v: sequence(start=v),
    'sequence first': lambda v: sequence(first=v),
}


def switched_twice(goal_speed):
    rollout = Rollout(SKILL, goal_speed=goal_speed)
    for shift in (0.1, 0.2):
        rollout.retarget(SKILL.goal + np.r_[shift, np.zeros(6)])
        rollout.advance(0.1)
    return rollout.advance(1.0).point


def observed(weights):
    rollout = Rollout(SKILL, phase_stopping=1.0, error_weights=weights)
    rollout.observe(SKILL.goal)
    return np.append(rollout.advance(0.1).point, rollout.speed)


@pytest.mark.parametrize('call', CALLS)
def test_a_value_gives_a_named_error_or_a_finite_result(call):
    for name, value in VALUES.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter('ignore')
                result = CALLS[call](value)
        except GdmpError:
            continue
        except Exception as error:
            number = isinstance(value, float) and call == 'advance'
            if isinstance(error, (TypeError, ValueError)) and call in WRONG_TYPE and not number:
                continue
            raise AssertionError(f'{call} = {name}: {type(error).__name__}: {error}') from error
        if isinstance(result, (np.ndarray, list, float)):
            assert np.isfinite(np.asarray(result)).all(), f'{call} = {name}: {result}'


def test_a_final_velocity_of_a_motion_of_hours():
    velocity = np.array([1e-4, 0.0, 0.0, 0.0, 0.0, 0.0])
    rollout = Rollout(SKILL, duration=8000.0, final_velocity=velocity)
    for _ in range(8):
        state = rollout.advance(1000.0)
    np.testing.assert_allclose(state.velocity[:3], velocity[:3], atol=2e-6)


def test_numbers_of_numpy_in_the_provenance_are_saved(tmp_path):
    skill = Skill.learn(TAKES[0], 10, provenance={
        'trial': np.int64(3), 'scores': np.array([1.0, 2.5]), 'file': tmp_path / 'take'})
    skill.save(tmp_path / 'skill.json')
    assert Skill.load(tmp_path / 'skill.json').provenance == {
        'trial': 3, 'scores': [1.0, 2.5], 'file': str(tmp_path / 'take')}
    odd = Skill.learn(TAKES[0], 10, provenance={'of': object()})
    with pytest.raises(GdmpError, match='object is not plain text'):
        odd.save(tmp_path / 'odd.json')
    assert not (tmp_path / 'odd.json').exists()


def test_products_of_named_products_keep_their_names():
    assert Product(TOOL, Euclidean(1)).names == ('position', 'orientation', 'euclidean')
    assert Product(TOOL, TOOL).names == ('position1', 'orientation1', 'position2', 'orientation2')
    plain = Product(Product(Euclidean(1), Euclidean(1)), Euclidean(1))
    assert plain.names == ('euclidean1', 'euclidean2', 'euclidean3')

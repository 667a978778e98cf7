"""Sequences: joins without a step, rhythmic parts, holds, signals, going on at another step."""
import numpy as np
import pytest

from gdmp_ros import (
    DataError,
    Euclidean,
    ParameterError,
    Skill,
    Sphere,
    UnitQuaternion,
)
from gdmp_ros.data.sequences import read_sequence
from gdmp_ros.dmp.sequence import HoldStep, MotionStep, SequenceRollout, SkillSequence
from test.motions import cycle, MANIFOLDS, motion, recorded_cycles, TOOL

DT = 1e-3


@pytest.fixture(scope='module')
def library():
    """Two skills and a rhythmic one on each manifold."""
    rng, made = np.random.default_rng(0), {}
    for manifold in MANIFOLDS:
        skills = [Skill.learn(motion(manifold, rng, 0.8, 0.3), 20) for _ in range(2)]
        curve = cycle(manifold, rng, 0.2)
        made[manifold] = [*skills, Skill.learn_rhythmic(recorded_cycles(
            manifold, curve, 0.9, 3.2), n_basis=20)]
    return made


def _near(manifold, point, size, rng):
    away = manifold.random_tangent(point, rng)
    return manifold.exp(point, size * rng.uniform() * away / manifold.norm(point, away))


def random_sequence(manifold, skills, rng):
    """Three to six steps, near one place, some of which take over from one in motion."""
    steps, middle = [], skills[0].goal
    for number in range(rng.integers(3, 7)):
        kind = rng.integers(0, 4) if number else 0
        blend = float(rng.choice([0.0, 0.05, 0.2, 0.35]))
        if kind == 3:
            steps.append(HoldStep(f'hold {number}', float(rng.uniform(0.0, 0.1))))
            continue
        goal = _near(manifold, middle, 0.4, rng)
        if kind == 2:
            steps.append(MotionStep(f'cycle {number}', skills[2], goal, blend=blend,
                                    cycles=float(rng.uniform(0.2, 1.5)),
                                    amplitude=float(rng.uniform(0.3, 1.3))))
        else:
            steps.append(MotionStep(f'motion {number}', skills[kind], goal, blend=blend,
                                    duration=float(rng.uniform(0.8, 1.5))))
    return SkillSequence(steps)


@pytest.mark.parametrize('seed', range(40))
def test_no_join_has_a_step_of_position_velocity_or_acceleration(library, seed):
    rng = np.random.default_rng(seed)
    manifold = MANIFOLDS[seed % len(MANIFOLDS)]
    skills = library[manifold]
    rollout = SequenceRollout(random_sequence(manifold, skills, rng), skills[0].start)
    before, joins = rollout.advance(0.0), 0
    changes, at_joins = [], []
    index = rollout.course.index
    for _ in range(15000):
        state = rollout.advance(DT)
        frame = manifold.frame(before.point)
        moved = manifold.log_in_frame(frame, state.point)[0]
        carried = manifold.transport_frame(frame, moved)
        first = [manifold.to_frame(frame, one) for one in (before.velocity, before.acceleration)]
        second = [manifold.to_frame(carried, one) for one in (state.velocity, state.acceleration)]
        # What the velocity and the acceleration say of the step that was made.
        jumps = (np.linalg.norm(moved - 0.5 * DT * (first[0] + second[0])),
                 np.linalg.norm(second[0] - first[0] - 0.5 * DT * (first[1] + second[1])),
                 np.linalg.norm(second[1] - first[1]))
        changes.append(jumps)
        if rollout.course.index != index:
            index, joins = rollout.course.index, joins + 1
            at_joins.append(len(changes))  # the next tick is the first one of the new motion
        before = state
        if rollout.finished:
            break
    assert rollout.finished and joins >= 2
    changes = np.array(changes)
    for tick in (one for one in at_joins if one + 5 < len(changes)):
        # The filter of the new motion changes the acceleration within its own time constant, 27
        # ticks and more. A step would be many times larger than the changes after it.
        position, velocity, acceleration = changes[tick]
        after = changes[tick + 1:tick + 6, 2].max(initial=0.0)
        assert acceleration <= 2.0 * after + 1e-6 * changes[:, 2].max()
        # Nothing else than this change of the acceleration is missing.
        assert velocity <= DT * max(acceleration, after) + 1e-9
        assert position <= DT ** 2 * max(acceleration, after) + 1e-9


def test_a_sequence_stops_at_each_goal_unless_it_blends(library):
    manifold = Euclidean(3)
    first, second, _ = library[manifold]
    for blend in (0.0, 0.3):
        steps = [MotionStep('there', first, second.start, blend=blend),
                 MotionStep('on', second)]
        rollout, speeds = SequenceRollout(SkillSequence(steps)), []
        while not rollout.finished:
            state = rollout.advance(DT)
            if rollout.course.index == 1:
                speeds.append(float(np.linalg.norm(state.velocity)))
        at_the_join = speeds[0]
        assert (at_the_join > 0.2) if blend else (at_the_join < 0.02)
        np.testing.assert_allclose(state.point, second.goal, atol=2e-3)


def test_cycles_and_signals_end_a_rhythmic_step(library):
    manifold = UnitQuaternion()
    _, motion_after, wipe = library[manifold]
    steps = [MotionStep('wipe', wipe, cycles=2.0), MotionStep('until', wipe, until='enough'),
             HoldStep('wait', until='go'), MotionStep('away', motion_after)]
    rollout = SequenceRollout(SkillSequence(steps), wipe.goal)
    times = {}
    while not rollout.finished:
        state = rollout.advance(DT)
        times.setdefault(rollout.course.index, state.time)
        if rollout.course.index == 1 and state.time > times[1] + 3.0:
            rollout.signal('something else')
            rollout.signal('enough')
        if rollout.course.index == 2 and state.time > times[2] + 0.5:
            rollout.signal('go')
        assert state.time < 30.0
    # Two cycles, then the way to rest within 1.5 more.
    assert 2.0 * wipe.duration < times[1] < 3.6 * wipe.duration
    assert times[2] - times[1] > 3.0 and times[3] - times[2] == pytest.approx(0.5, abs=0.01)


def test_it_goes_on_with_any_step_from_where_it_is(library):
    manifold = TOOL
    first, second, wipe = library[manifold]
    sequence = SkillSequence([MotionStep('a', first), MotionStep('b', wipe, cycles=1.0),
                         MotionStep('c', second)])
    rollout = SequenceRollout(sequence)
    for _ in range(300):
        before = rollout.advance(DT)
    rollout.go_to(2)
    after = rollout.advance(0.0)
    assert manifold.distance(before.point, after.point) < 1e-9
    np.testing.assert_allclose(after.velocity, before.velocity, atol=1e-6)
    later = SequenceRollout(sequence, first=2)
    assert later.course.step.name == 'c'
    for bad in (3, -1):
        with pytest.raises(ParameterError, match='step is'):
            rollout.go_to(bad)
        with pytest.raises(ParameterError, match='step is'):
            SequenceRollout(sequence, first=bad)


def test_what_does_not_fit_is_refused(library):
    first, _, wipe = library[Euclidean(3)]
    other = library[Sphere(2)][0]
    with pytest.raises(DataError, match='a sequence needs a step with a skill'):
        SkillSequence([HoldStep('hold', 1.0)])
    with pytest.raises(DataError, match='step two is on'):
        SequenceRollout(SkillSequence([MotionStep('one', first), MotionStep('two', other)]))
    for make in (lambda: MotionStep('m', first, cycles=2.0),
                 lambda: MotionStep('m', wipe), lambda: MotionStep('m', wipe, cycles=-1.0),
                 lambda: MotionStep('m', first, blend=0.9),
                 lambda: MotionStep('m', first, duration=0.0),
                 lambda: MotionStep('m', wipe, cycles=1.0, amplitude=3.0),
                 lambda: HoldStep('h'), lambda: HoldStep('h', -1.0)):
        with pytest.raises(ParameterError, match='step [mh]:'):
            make()


FILE = """
steps:
  - skill: first.json
    name: there
    goal: [0.1, 0.2, 0.3]
    duration: 2.5
  - gripper: {width: 0.02, force: 20}
  - hold: 0.5
  - skill: wipe.json
    cycles: 3
    frequency: 0.5
    amplitude: 0.8
    blend: 0.1
  - skill: first.json
  - hold:
    until: done
"""


def test_a_file_has_the_steps_and_the_skills_beside_it(library, tmp_path):
    first, _, wipe = library[Euclidean(3)]
    first.save(tmp_path / 'first.json')
    wipe.save(tmp_path / 'wipe.json')
    path = tmp_path / 'sequence.yaml'
    path.write_text(FILE)
    steps = read_sequence(path).steps
    assert [step.name for step in steps] == ['there', 'gripper 2', 'hold 3', 'wipe', 'first',
                                             'wait for done']
    assert steps[0].goal.tolist() == [0.1, 0.2, 0.3] and steps[0].duration == 2.5
    assert (steps[1].command.width, steps[1].command.force) == (0.02, 20.0)
    assert steps[3].duration == 2.0 and steps[3].cycles == 3.0 and steps[3].blend == 0.1
    assert steps[5].until == 'done' and steps[5].seconds == np.inf


@pytest.mark.parametrize('text, match', [
    ('steps: [', 'not a sequence file'), ('[]', 'expected "steps"'),
    ('steps: []', '1 to 1000 steps'), ('steps: [{}]', 'step 1: expected one of'),
    ('steps: [{hold: x}]', 'step 1: hold: expected a number'),
    ('steps: [{hold: 1, skill: a}]', 'step 1: expected one of'),
    ('steps: [{skill: none.json}]', 'step 1: .*none.json'),
    ('steps: [{skill: first.json, gaol: [1]}]', 'step 1: unknown key gaol'),
    ('steps: [{skill: first.json, goal: [1, 2]}]', 'goal has 2 numbers, expected 3'),
    ('steps: [{skill: first.json, goal: [1, 2, x]}]', 'goal: expected numbers'),
    ('steps: [{skill: first.json, goal: [1, 2, .nan]}]', 'step 1'),
    ('steps: [{skill: first.json, frequency: 1}]', 'frequency'),
    ('steps: [{gripper: {force: 1}}]', 'gripper: expected width'),
    ('steps: [{gripper: {width: -1}}]', 'step 1: gripper'),
    ('steps: [{hold: 1}]', 'needs a step with a skill'),
    ('steps: [{hold: ' + 400 * '9' + '}]', 'step 1: hold: the number is too large'),
    ('steps: [{hold: 2001-13-45}]', 'not a sequence file'),
    ('steps: [{hold: !!int ""}]', 'not a sequence file'),
    ('steps: [{skill: first.json, goal: [' + 400 * '9' + ', 1, 2]}]', 'goal: expected numbers')])
def test_a_file_that_is_wrong_is_refused_with_the_step(library, tmp_path, text, match):
    library[Euclidean(3)][0].save(tmp_path / 'first.json')
    path = tmp_path / 'sequence.yaml'
    path.write_text(text)
    with pytest.raises(DataError, match=match) as raised:
        read_sequence(path)
    assert str(raised.value).count(str(path)) == 1

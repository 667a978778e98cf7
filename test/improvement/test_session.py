"""The improvement of a skill: the same result whoever makes the roll-outs, and after a stop."""
from dataclasses import replace

import numpy as np
import pytest

from experiments.bench.improve import ViaPoint
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.errors import DataError, ParameterError
from gdmp_ros.improvement.session import Effort, improve, Job, Judgement, roll_out, subject
from gdmp_ros.improvement.task import Outcome
from gdmp_ros.improvement.variables import Tempo, Variables
from gdmp_ros.util.parallel import Journal, map_tasks

EFFORT = Effort(12, 8, 2, 3)
GOOD, BETTER = Judgement([2.0, 3.0], [True, True]), Judgement([1.0, 2.0], [True, True])


class Noisy(ViaPoint):
    """A via point whose costs depend on the situation, and a skill that some of them end."""

    def rollout(self, skill, seed):
        outcome = super().rollout(skill, seed)
        noise = np.random.default_rng(seed).random()
        if noise > 0.95:
            return Outcome(None, ended='too noisy')
        return Outcome({**outcome.terms, 'noise': 0.1 * noise}, noise < 0.5)


def task_and_variables():
    task = Noisy(via=5.0)
    return task, Variables(task.skill(), task.variables())


def improved(execute, effort=EFFORT, search='pibb', seed=3):
    task, variables = task_and_variables()
    *_, state = improve(task, variables, execute, effort, search, seed)
    return state


def plainly(title, jobs):
    return {key: roll_out(job) for key, job in jobs.items()}


def check_equal(first, second):
    np.testing.assert_array_equal(first.search.mean, second.search.mean)
    np.testing.assert_array_equal(first.search.covariance, second.search.covariance)
    assert [one.costs for one in first.updates] == [one.costs for one in second.updates]
    assert first.after == second.after


@pytest.fixture(scope='module')
def reference():
    return improved(plainly)


@pytest.mark.parametrize('seed', range(3))
def test_a_skill_becomes_better(seed):
    better = improved(plainly, Effort(40, 16, 1, 3), seed=seed)
    assert better.after.median < 0.9 * better.before.median


def test_a_skill_says_where_it_comes_from(reference):
    assert reference.rollouts == EFFORT.rollouts == 192
    assert any(one.ended for one in reference.updates)
    better = replace(reference, before=GOOD, after=BETTER)
    skill = better.skill()
    source = skill.provenance['improved']
    assert (source['rollouts'], source['seed'], source['search']) == (192, 3, 'pibb')
    assert source['after']['median_cost'] == BETTER.median
    assert source['skill'] == dict(reference.variables.skill.provenance)


def test_a_skill_that_became_worse_is_not_taken(reference):
    worse = replace(reference, before=BETTER, after=GOOD)
    assert worse.worse and not replace(reference, before=GOOD, after=BETTER).worse
    np.testing.assert_array_equal(worse.skill().weights, reference.variables.skill.weights)
    assert 'kept' in worse.skill().provenance['improved']
    # Success counts first, then what was ended early, then the cost.
    ranks = [Judgement([1.0, 2.0], [True, True]), Judgement([0.0, 0.0], [True, False]),
             Judgement([None, 0.0], [True, False]), Judgement([None, None], [False, False])]
    assert [one.rank for one in ranks] == sorted(one.rank for one in ranks)


def test_a_saved_skill_moves_as_the_improved_one(reference, tmp_path):
    skill = reference.skill()
    skill.save(tmp_path / 'skill.json')
    loaded = Skill.load(tmp_path / 'skill.json')
    np.testing.assert_array_equal(loaded.reproduce(0.01).points, skill.reproduce(0.01).points)
    assert loaded.provenance == skill.provenance


def test_two_processes_give_the_same(reference):
    check_equal(improved(lambda title, jobs: map_tasks(title, roll_out, jobs, 2)), reference)


@pytest.mark.parametrize('stop', [0, 1, 40, 95, 100])
def test_stopped_at_any_roll_out_and_resumed_gives_the_same(reference, tmp_path, stop):
    task, variables = task_and_variables()
    about = subject(task, variables, 'pibb', EFFORT, 3)
    path, made = tmp_path / 'rollouts.jsonl', []

    class Stopped(Exception):
        pass

    def stopping(title, jobs):
        journal = Journal(path, about)
        for key, job in jobs.items():
            if key not in journal.results:
                if len(made) == stop:
                    raise Stopped
                made.append(key)
                journal.keep(key, roll_out(job))
        return journal.results

    with pytest.raises(Stopped):
        improved(stopping)
    with path.open('a') as file:
        file.write('["5/0/0", [{"via')  # killed while it wrote

    def resumed(title, jobs):
        return map_tasks(title, counted, jobs, journal=Journal(path, about))

    def counted(job):
        made.append(job)
        return roll_out(job)
    check_equal(improved(resumed), reference)
    assert len(made) == EFFORT.rollouts + 2 * EFFORT.held_out


def test_roll_outs_of_something_else_are_not_taken(tmp_path):
    task, variables = task_and_variables()
    path = tmp_path / 'rollouts.jsonl'
    Journal(path, subject(task, variables, 'pibb', EFFORT, 3))
    others = [subject(task, variables, 'pibb', EFFORT, 4),
              subject(task, variables, 'cma', EFFORT, 3),
              subject(task, variables, 'pibb', EFFORT._replace(samples=9), 3),
              subject(task, Variables(variables.skill, [Tempo()]), 'pibb', EFFORT, 3),
              subject(Noisy(via=2.0), variables, 'pibb', EFFORT, 3)]
    for other in others:
        with pytest.raises(DataError, match='not a journal of'):
            Journal(path, other)
    # More updates go on from what is there.
    Journal(path, subject(task, variables, 'pibb', EFFORT._replace(updates=99), 3))


def test_all_skills_of_an_update_are_tried_in_the_same_situations(reference):
    seeds = {}

    def noting(title, jobs):
        for key, job in jobs.items():
            update, _, situation = key.split('/')
            seeds.setdefault((update, situation), set()).add(job.seed)
        return plainly(title, jobs)
    improved(noting)
    assert all(len(one) == 1 for one in seeds.values())
    assert len(set.union(*seeds.values())) == EFFORT.updates * 2 + EFFORT.held_out


def test_a_skill_that_cannot_be_made_was_ended_early():
    task, variables = task_and_variables()
    outcome = Outcome(*roll_out(Job(task, variables, np.full(variables.size, np.nan), 0)))
    assert outcome.cost is None and 'no such skill' in outcome.ended


def test_numbers_out_of_range_are_refused():
    for name, value in (('updates', 0), ('samples', 1), ('situations', 0), ('held_out', -1)):
        with pytest.raises(ParameterError, match=name):
            improved(plainly, EFFORT._replace(**{name: value}))
    with pytest.raises(ParameterError, match='expected one of'):
        improved(plainly, search='luck')


@pytest.mark.long
def test_two_workers_of_a_dask_cluster_give_the_same(reference):
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        check_equal(improved(lambda title, jobs: map_tasks(
            title, roll_out, jobs, dask=cluster.scheduler_address)), reference)

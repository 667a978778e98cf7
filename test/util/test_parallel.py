"""Many tasks on processes and on a Dask cluster; interrupted runs continue where they stopped."""
import json
import time

import pytest

from experiments.bench import accuracy
from gdmp_ros.errors import DataError
from gdmp_ros.util.parallel import Journal, map_tasks, scheduler_address


def slow_square(number):
    time.sleep(0.01)
    return number * number


TASKS = {str(i): i for i in range(12)}
SQUARES = {str(i): i * i for i in range(12)}


@pytest.mark.parametrize('jobs', [1, 2])
def test_results_come_in_the_order_of_the_tasks(jobs):
    done = map_tasks('squares', slow_square, TASKS, jobs)
    assert done == SQUARES and list(done) == list(TASKS)


def test_finished_tasks_are_not_done_again(tmp_path):
    path = tmp_path / 'journal.jsonl'
    first = Journal(path, 'squares')
    map_tasks('squares', slow_square, {k: TASKS[k] for k in list(TASKS)[:5]}, journal=first)
    text = path.read_text()
    path.write_text(text.replace('["2", 4]', '["2", -4]') + '["9", 8')  # killed while writing
    done = map_tasks('squares', slow_square, TASKS, journal=Journal(path, 'squares'))
    assert done == {**SQUARES, '2': -4}  # read from the journal, not computed again
    with pytest.raises(DataError, match='not a journal of cubes'):
        Journal(path, 'cubes')


@pytest.mark.long
def test_a_local_cluster_of_two_workers_does_the_same(tmp_path):
    from distributed import LocalCluster
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                      dashboard_address=None) as cluster:
        path = tmp_path / 'journal.jsonl'
        done = map_tasks('squares', abs, {k: -v for k, v in TASKS.items()},
                         dask=cluster.scheduler_address, journal=Journal(path, 'squares'))
        assert done == TASKS
        assert len(path.read_text().splitlines()) == 1 + len(TASKS)
        assert json.loads(path.read_text().splitlines()[-1])[0] in TASKS
        task = ('GShape', 'S3', 'parallel', 60)
        errors = map_tasks('accuracy', accuracy.one_class, {'one': task},
                           dask=cluster.scheduler_address)
        assert errors['one'] == pytest.approx(accuracy.one_class(task), rel=1e-9)


def test_a_missing_cluster_is_reported(monkeypatch):
    monkeypatch.setattr('gdmp_ros.util.parallel.CONNECT_S', 0.5)
    with pytest.raises(DataError, match='no Dask scheduler answers'):
        map_tasks('squares', slow_square, TASKS, dask='tcp://127.0.0.1:9')


def test_the_backend_is_named_with_an_address():
    assert scheduler_address(()) is None and scheduler_address(('dask', 'tcp://a:1')) == 'tcp://a:1'
    with pytest.raises(DataError, match='expected: dask ADDRESS'):
        scheduler_address(('ray', 'x'))

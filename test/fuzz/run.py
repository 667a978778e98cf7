"""
The long run: a coverage-guided fuzzer on every entrance, and raw bytes over DDS on live nodes.

    python -m test.fuzz.run --runs 100000 --out out/fuzz [ENTRANCE ...]

Writes fuzz.json and fuzz.md; an input that brings out anything but a named error is kept in
DIR/ENTRANCE. Exit code 1 if there is one.
"""
from __future__ import annotations

import argparse
import importlib
import inspect
import json
from pathlib import Path
import re
import shutil
import subprocess
import sys
import time

import gdmp_ros

#: Watched for new branches; kernels are compiled and cannot be.
WATCHED = ['gdmp_ros.ros', 'gdmp_ros.playback', 'gdmp_ros.data', 'gdmp_ros.realtime', 'rosbags']
LIVE = 'raw_bytes_over_dds'


def modules_with_kernels() -> list[str]:
    """Names of the modules of the package whose functions are compiled."""
    package = Path(gdmp_ros.__file__).parent
    return ['.'.join(path.relative_to(package.parent).with_suffix('').parts)
            for path in sorted(package.rglob('*.py'))
            if '\nfrom gdmp_ros.kernels' in path.read_text()]


def fuzz_here(name: str, runs: int, folder: Path) -> None:
    """Fuzz one entrance in this process, which does not return."""
    import atheris

    skill_file = importlib.import_module('gdmp_ros.dmp.skill_file')
    for key, function in list(vars(skill_file).items()):
        if inspect.isfunction(function) and function.__module__ == skill_file.__name__:
            setattr(skill_file, key, atheris.instrument_func(function))
    with atheris.instrument_imports(include=WATCHED, exclude=modules_with_kernels()):
        from test.fuzz.entrances import ENTRANCES
        entrance = ENTRANCES[name]()
    for seed in entrance.seeds:
        entrance.feed(seed)  # kernels are compiled before anybody takes the time
    corpus = folder / 'corpus'
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(entrance.seeds):
        (corpus / f'seed{number}').write_bytes(seed)
    longest = max(4096, 2 * max(map(len, entrance.seeds)))
    atheris.Setup([sys.argv[0], f'-runs={runs}', f'-max_len={longest}', '-timeout=60',
                   '-rss_limit_mb=4096', f'-artifact_prefix={folder}/', '-print_final_stats=1',
                   str(corpus)], entrance.feed)
    atheris.Fuzz()


def fuzz_live(runs: int, folder: Path) -> dict[str, object]:
    """Damaged messages over DDS to every topic of running nodes, which have to go on."""
    import random

    from gdmp_msgs.msg import MovingGoal, Reference
    from geometry_msgs.msg import PoseStamped
    from rclpy._rclpy_pybind11 import RCLError
    from rclpy.serialization import serialize_message
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64MultiArray

    from experiments.reliability.trial import FaultTrial, short_skill
    from gdmp_ros.ros.clients.testbed import ARM, process_bed, SERVER
    folder.mkdir(parents=True, exist_ok=True)
    with process_bed(FaultTrial, folder, skill=short_skill(folder)) as trial:
        trial.start(record=False)
        choose = random.Random(0)
        topics = {f'{SERVER}/goal_pose': PoseStamped(), f'{SERVER}/moving_goal': MovingGoal(),
                  f'{SERVER}/goal_stiffness': Float64MultiArray(data=[1.0] * 9),
                  f'{ARM}/measured_pose': PoseStamped(), '/clock': Clock(),
                  f'{SERVER}/reference': Reference()}
        publishers = [(trial.client.publisher(type(m), topic), bytes(serialize_message(m)))
                      for topic, m in topics.items()]
        trial.spend(2.0)
        sent, before, begun = 0, trial.state.ticks, time.monotonic()
        for number in range(runs):
            for publisher, valid in publishers:
                data = bytearray(valid)
                for _ in range(choose.randint(0, 6)):
                    at = choose.randrange(len(data) + 1)
                    data[at:at + choose.randint(0, 9)] = choose.randbytes(choose.randint(0, 9))
                try:
                    publisher.send(bytes(data))
                    sent += 1
                except RCLError:
                    pass  # longer than its type may be: the middleware does not send it
            if number % 100 == 0:
                trial.check()
                trial.spend(0.01)
        seconds = time.monotonic() - begun
        trial.spend(1.0)
        rate = (trial.state.ticks - before) / (seconds + 1.0)
        trial.client.execute()
        reached = trial.succeeded()
    return {'inputs': sent, 'seconds': seconds, 'crashes': 0 if reached else 1,
            'notes': f'{rate:.0f} ticks per second meanwhile, then a motion reached its goal'
            if reached else 'the motion afterwards did not reach its goal'}


def fuzz_apart(name: str, runs: int, folder: Path) -> dict[str, object]:
    """Fuzz one entrance in a process of its own."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    begun = time.monotonic()
    with (folder / 'log').open('w') as log:
        code = subprocess.run([sys.executable, '-m', 'test.fuzz.run', '--here', name, '--runs',
                               str(runs), '--out', str(folder)], stdout=log,
                              stderr=subprocess.STDOUT).returncode
    text = (folder / 'log').read_text(errors='replace')
    counted = re.search(r'number_of_executed_units:\s*(\d+)', text)
    features = re.findall(r'cov: (\d+) ft: (\d+)', text)
    found = sorted(p.name for p in folder.iterdir() if p.name.startswith(('crash', 'timeout',
                                                                          'oom', 'leak')))
    shutil.rmtree(folder / 'corpus', ignore_errors=True)
    return {'inputs': int(counted[1]) if counted else 0, 'seconds': time.monotonic() - begun,
            'crashes': max(len(found), int(code != 0)),
            'notes': ' '.join(found) or (f'{features[-1][0]} branches' if features else '')}


def main() -> int:
    """Fuzz every entrance, or those named."""
    from test.fuzz.entrances import ENTRANCES
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('what', nargs='*', metavar='ENTRANCE')
    parser.add_argument('--runs', type=int, default=100_000)
    parser.add_argument('--out', type=Path, default=Path('out/fuzz'))
    options = parser.parse_args()
    results: dict[str, dict[str, object]] = {}
    for name in options.what or [*ENTRANCES, LIVE]:
        print(f'{name} …', flush=True)
        folder = options.out / name
        results[name] = (fuzz_live(options.runs // 4, folder) if name == LIVE
                         else fuzz_apart(name, options.runs, folder))
        print(f'    {results[name]}', flush=True)
        lines = ['| entrance | inputs | seconds | crashes | notes |', '|---|---|---|---|---|']
        lines += [f'| {key} | {r["inputs"]} | {r["seconds"]:.0f} | {r["crashes"]} | {r["notes"]} |'
                  for key, r in results.items()]
        (options.out / 'fuzz.md').write_text('\n'.join(lines) + '\n')
        (options.out / 'fuzz.json').write_text(json.dumps(results, indent=1) + '\n')
    return int(any(r['crashes'] for r in results.values()))


if __name__ == '__main__':
    if '--here' in sys.argv:  # before anything is imported that is to be watched
        words = dict(zip(sys.argv[1::2], sys.argv[2::2]))
        fuzz_here(words['--here'], int(words['--runs']), Path(words['--out']))
    sys.exit(main())

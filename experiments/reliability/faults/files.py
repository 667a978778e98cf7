"""Skill files, bags and disks that change, break or fill up during use."""
from __future__ import annotations

from pathlib import Path
import shutil
import subprocess

from experiments.reliability.trial import FaultTrial, FRAME, judge_limits
from experiments.reliability.trial_result import TrialResult
from gdmp_ros.data import lasa, recordings, runs
from gdmp_ros.ros.clients.testbed import RECORDER, SERVER


def skill_file(trial: FaultTrial, quick: bool) -> TrialResult:
    """Skill file changed, truncated and removed while it is being executed"""
    from gdmp_msgs.srv import LoadSkill
    outcome, path = TrialResult(), trial.folder / 'skill.json'
    shutil.copy(trial.skill, path)
    text = path.read_text()
    trial.start(server={'skill': str(path)})
    trial.execute()
    trial.wait_progress(0.1)
    for what, change in (('truncated', lambda: path.write_text(text[:len(text) // 2])),
                         ('changed', lambda: path.write_text(text.replace('[', '{', 3))),
                         ('removed', path.unlink)):
        change()
        reply = trial.call(LoadSkill, f'{SERVER}/load_skill', path=str(path))
        outcome.claim(f'{what}: refused, naming the file',
                      not reply.success and path.name in reply.message)
    trial.reaches_goal(outcome, 'the motion under way reaches its goal')
    trial.execute()
    trial.reaches_goal(outcome, 'the skill in memory can be executed again')
    trial.finish(outcome, None)
    return outcome


def bag_file(trial: FaultTrial, quick: bool) -> TrialResult:
    """Bag truncated and removed while a skill is learned from it, both storages"""
    from gdmp_msgs.srv import LearnSkill
    outcome = TrialResult()
    trial.start()
    trial.execute()
    for storage in ('mcap', 'sqlite3'):
        bag = trial.folder / f'bag_{storage}'
        recordings.write(bag, lasa.robot_demonstrations('GShape')[0], FRAME, 10 ** 18,
                         storage=storage)
        data = next(path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))
        data.write_bytes(data.read_bytes()[:data.stat().st_size // 2])
        reply = trial.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(bag)])
        outcome.claim(f'{storage} truncated: refused, naming the bag',
                      not reply.success and bag.name in reply.message)
        shutil.rmtree(bag)
        reply = trial.call(LearnSkill, f'{SERVER}/learn_skill', bags=[str(bag)])
        outcome.claim(f'{storage} removed: refused, naming the bag',
                      not reply.success and bag.name in reply.message)
    trial.reaches_goal(outcome, 'the motion under way reaches its goal')
    trial.finish(outcome, None)
    return outcome


def disk_full(trial: FaultTrial, quick: bool) -> TrialResult:
    """Disk full while recording"""
    outcome, disk = TrialResult(), trial.folder / 'disk'
    disk.mkdir()
    try:
        subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=16m', 'tmpfs', str(disk)],
                       capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        outcome.missing = (f'a small disk cannot be mounted: '
                           f'{(getattr(error, "stderr", "") or str(error)).strip()}')
        return outcome
    try:
        return _fill(trial, disk, outcome)
    finally:
        subprocess.run(['umount', '-l', str(disk)], check=False)


def _fill(trial: FaultTrial, disk: Path, outcome: TrialResult) -> TrialResult:
    trial.start_arm()
    trial.start_server()
    trial.wait_holding()
    bag = disk / 'run'
    trial.record(bag, ['--keep-free', '6'])
    recorder = trial.children.processes[RECORDER]
    trial.execute()
    trial.wait('the disk to fill', lambda: recorder.poll() is not None, 60.0)
    outcome.need('exit code of the recorder', recorder.returncode, lambda v: v == 1)
    outcome.claim('it reports the reason', 'the disk is nearly full' in trial.log(RECORDER))
    run = runs.read(bag)
    outcome.need('references kept', len(run.sequences), lambda v: v > 2000)
    outcome.need('references lost', runs.lost(run), lambda v: v == 0)
    judge_limits(run, outcome)
    trial.reaches_goal(outcome)
    return outcome

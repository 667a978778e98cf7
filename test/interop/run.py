"""
Exchange files with the real libraries: `make interop`, outside CI (it loads gigabytes once).

    python -m test.interop.run [--out out/interop] [PART ...]

Each part has an environment of its own in the output folder. Its libraries write files of a known
motion, which are learned here; a demonstration is converted here, and read there. Exit code 1 if
a reading is wrong.
"""
from __future__ import annotations

import argparse
import json
from pathlib import Path
import shutil
import subprocess
import sys
from typing import NamedTuple

import numpy as np

from gdmp_ros import Skill
from gdmp_ros.cli.main import main as gdmp
from gdmp_ros.manifolds import Euclidean
from gdmp_ros.util.terminal import progress, table
from test.interop.libraries import Truth

SCRIPT = Path(__file__).with_name('libraries.py')
#: Largest error of a start or goal [m or rad]: float32 has seven digits.
EXACT = 1e-6
#: Largest error of an action that is replayed, a hundredth of the way [deg, % of the gripper].
CLOSE = 0.9
#: Options with which all motors are learned, as they were commanded.
MOTORS = ['--joints', 'action', '--units', 'deg']


class Part(NamedTuple):
    """
    Libraries of one environment.

    :ivar packages: for pip
    :ivar writes: functions of `libraries` that write, and that read
    :ivar files: that are written, with the options that our reader needs
    :ivar ours: names of what they read, with options of ``gdmp convert``
    :ivar replays: whether a skill of motors is replayed
    """

    packages: tuple[str, ...]
    writes: tuple[str, ...]
    reads: tuple[str, ...]
    files: dict[str, list[str]]
    ours: dict[str, list[str]]
    replays: bool = False


_LEROBOT = {'lerobot_joints': ['--joints'], 'lerobot_poses': [], 'lerobot_motors': MOTORS}
PARTS = {
    'tables': Part(('evo', 'pandas', 'pyarrow'), ('tables',), ('tables',), {
        name: [] for name in ('pandas_index.csv', 'pandas.csv', 'pandas_german.csv',
                              'pandas.csv.gz', 'pandas.parquet', 'pandas_dates.csv',
                              'pandas_dates.parquet', 'pyarrow.csv', 'lists.parquet', 'evo.tum',
                              'evo_pandas.csv')}, {'ours.tum': [], 'ours.csv': []}),
    'bags': Part(('mcap-ros2-support', 'rosbags'), ('bags',), ('bags',), {
        name: [] for name in ('mcap_ros2.mcap', 'sqlite', 'mcap', 'noetic.bag')},
        {'ours_mcap': []}),
    'lerobot-0.3': Part(('lerobot==0.3.3',), ('lerobot',), (), _LEROBOT, {}),
    'lerobot-0.4': Part(('lerobot==0.4.4',), ('lerobot',), ('lerobot',), _LEROBOT,
                        {'ours_lerobot': ['--as', 'lerobot', '--fps', '50']}, replays=True),
    'robomimic': Part(('robomimic==0.3.0', 'h5py'), (), ('robomimic',), {},
                      {'ours.hdf5': ['--as', 'robomimic', '--fps', '50']}),
}


def environment(folder: Path, packages: tuple[str, ...]) -> Path:
    """Interpreter of an environment with the packages; it is made once."""
    python, done = folder / 'bin' / 'python', folder / 'complete'
    if not done.exists():
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run([sys.executable, '-S', '-m', 'venv', folder], check=True)
        subprocess.run([python, '-m', 'pip', 'install', '--quiet', *packages], check=True)
        done.touch()
    return python


def call(python: Path, part: str, what: str, folder: Path) -> dict[str, object]:
    """Call a function of `libraries`; what it returns."""
    done = subprocess.run([python, SCRIPT, part, what, folder], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f'{part} {what}: {done.stderr[-2000:]}')
    lines = [line for line in done.stdout.splitlines() if line.startswith('RESULT ')]
    return json.loads(lines[-1].removeprefix('RESULT ')) if lines else {}


def learned(path: Path, options: list[str], folder: Path) -> float:
    """Learn from a file; largest error of duration, start and goal."""
    skill_file = folder / f'{path.name}.skill.json'
    if gdmp(['learn', str(path), '-o', str(skill_file), '--json', *options]):
        return float('inf')
    skill = Skill.load(skill_file)
    first = skill.manifold.factors[0]
    if isinstance(first, Euclidean) and first.point_size == 6:
        wanted = np.radians(Truth.motors[[0, -1]])
    elif isinstance(first, Euclidean) and first.point_size == 7:
        wanted = Truth.joints[[0, -1]]
    else:
        wanted = np.hstack([Truth.position, np.roll(Truth.xyzw, 1, axis=1)])[[0, -1]]
    errors = [abs(skill.duration - Truth.times[-1])]
    for point, expected in zip((skill.start, skill.goal), wanted):
        flat = point.reshape(-1)[:7].copy()
        if len(expected) == 7 and abs(np.linalg.norm(expected[3:]) - 1.0) < 1e-9:
            flat[3:7] *= np.sign(flat[3:7] @ expected[3:])
        errors.append(float(np.abs(flat - expected).max()))
    return max(errors)


def replayed(python: Path, folder: Path) -> list[str]:
    """Error and verdict of a skill of motors that LeRobot replays from where the robot is."""
    skill, here = folder / 'motors.skill.json', Truth.motors[0] + [4.0, -3.0, 0.0, 6.0, 0.0, -9.0]
    if (gdmp(['learn', str(folder / 'lerobot_motors'), '-o', str(skill), *MOTORS])
            or gdmp(['convert', str(skill), '-o', str(folder / 'ours_motors'), '--as', 'lerobot',
                     '--start', *map(str, here)])):
        return ['', 'WRONG']
    sent = call(python, 'replay', 'read', folder)['sent']
    rows = np.array([list(one.values()) for one in sent])
    error = float(max(np.abs(rows[0] - here).max(), np.abs(rows[-1] - Truth.motors[-1]).max()))
    names = [f'{name}.pos' for name in ('shoulder_pan', 'shoulder_lift', 'elbow_flex',
                                        'wrist_flex', 'wrist_roll', 'gripper')]
    return [f'{error:.1e}', 'right' if error < CLOSE and list(sent[0]) == names else 'WRONG']


def check(name: str, part: Part, folder: Path) -> list[list[str]]:
    """Rows of the table of one part."""
    python = environment(folder / 'environments' / name, part.packages)
    files = folder / name
    shutil.rmtree(files, ignore_errors=True)
    files.mkdir(parents=True)
    rows = []
    for function in part.writes:
        call(python, function, 'write', files)
    for file, options in part.files.items():
        error = learned(files / file, options, files)
        rows.append([name, f'{file} read here', f'{error:.1e}',
                     'right' if error < EXACT else 'WRONG'])
    if part.ours:
        rows_csv = np.hstack([Truth.times[:, None], Truth.position, Truth.xyzw])
        np.savetxt(files / 'truth.csv', rows_csv, delimiter=',', comments='', fmt='%.12f',
                   header='time,x,y,z,qx,qy,qz,qw')
    for file, options in part.ours.items():
        if gdmp(['convert', str(files / 'truth.csv'), '-o', str(files / file), *options]):
            rows.append([name, f'{file} written here', '', 'WRONG'])
    if part.replays:
        rows.append([name, 'a skill of motors, replayed by lerobot-replay',
                     *replayed(python, files)])
    for function in part.reads:
        for reader, (ends, count) in call(python, function, 'read', files).items():
            error = float(np.abs(np.array(ends) - Truth.position[[0, -1]]).max())
            good = error < EXACT and abs(count - len(Truth.times)) <= 1
            rows.append([name, f'ours read by {reader}, {count} samples', f'{error:.1e}',
                         'right' if good else 'WRONG'])
    return rows


def main() -> int:
    """Check the parts; 0 if all is right."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('parts', nargs='*', metavar='PART', help=', '.join(PARTS))
    parser.add_argument('--out', type=Path, default=Path('out/interop'), metavar='DIR')
    options = parser.parse_args()
    names = options.parts or list(PARTS)
    if unknown := set(names) - set(PARTS):
        parser.error(f'{", ".join(sorted(unknown))}: expected {", ".join(PARTS)}')
    rows = []
    with progress('exchanging', len(names)) as step:
        for name in names:
            rows += check(name, PARTS[name], options.out.absolute())
            step()
    table('files of the real libraries', ['part', 'file', 'error', 'verdict'], rows)
    return 0 if all(row[-1] == 'right' for row in rows) else 1


if __name__ == '__main__':
    sys.exit(main())

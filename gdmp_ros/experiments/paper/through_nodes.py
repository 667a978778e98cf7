"""A skill executed by ``trajectory_server`` and ``panda_sim`` as processes; needs ROS."""
from __future__ import annotations

from pathlib import Path
import shutil

import numpy as np

from gdmp_ros.data import runs
from gdmp_ros.dmp import Skill
from gdmp_ros.errors import GdmpError
from gdmp_ros.experiments.paper.experiment import Data

#: Recorded after the motion has ended [s].
_TAIL_S = 0.5


def execute_skill(skill: Skill, scene: Path, folder: Path, rotational: float) -> Data:
    """
    Run a skill in a scene; what the bag of references and robot states says, every tick.

    :param scene: MJCF file with the sites ``tcp`` and ``lip`` and the tray
    :param folder: for skill, bag and logs; replaced
    :param rotational: K_o [Nm/rad]
    :returns: reference, pose, stiffness, joints, height of the lip and contacts with the tray
    :raises GdmpError: if the motion does not end well
    """
    from gdmp_ros.ros.testbed import session
    from gdmp_ros.util.dds_network import Domain
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    skill.save(folder / 'skill.json')
    domain = Domain()
    try:
        with session(folder, domain.environment(), {'model': str(scene.resolve())}, {
                'skill': str((folder / 'skill.json').resolve()),
                'rotational_stiffness': [rotational] * 3}) as (operator, _):
            operator.spend(1.0)
            operator.execute()
            result = operator.result(60.0)
            operator.spend(_TAIL_S)
    finally:
        domain.release()
    if result.error_code != result.SUCCESSFUL:
        raise GdmpError(f'the motion ended with {result.error_code}: {result.error_string}')
    run = runs.read(folder / 'run')
    begins = int(np.searchsorted(run.state_stamps,
                                 run.reference_stamps[int(np.argmax(run.moving))]))
    at = np.searchsorted(run.sequences, run.applied[begins:])
    wanted = run.references[np.minimum(at, len(run.references) - 1)]
    data = {'reference': wanted, 'pose': run.poses[begins:],
            'stiffness': run.stiffness[begins:].reshape(-1, 6, 6)[:, :3, :3],
            'joints': run.joints[begins:]}
    return {**data, **_seen(scene, data['joints'])}


def _seen(scene: Path, joints: np.ndarray) -> Data:
    """Height of the lip and contacts with the tray, from the joints."""
    from gdmp_ros.sim.arm import Arm
    from gdmp_ros.sim.scenes import contact_count
    arm, lip, contacts = Arm(scene), [], []
    for q in joints:
        arm.reset(q)
        lip.append(arm.site_pose('lip')[2])
        contacts.append(contact_count(arm.model, arm.data, 'tray'))
    return {'lip': np.array(lip), 'contacts': np.array(contacts)}

"""A skill executed by ``trajectory_server`` and ``panda_sim`` as processes; needs ROS."""
from __future__ import annotations

from pathlib import Path
import shutil

import numpy as np

from experiments.paper.experiment import Data
from gdmp_ros.data.runs import Run
from gdmp_ros.dmp.skill import Skill
from gdmp_ros.ros.clients.testbed import NodeTestbed, process_bed
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.scenes import contact_count

#: Time that is recorded after the end of the motion [s].
_TAIL_S = 0.5


def execute_skill(skill: Skill, scene: Path, folder: Path, rotational: float) -> Data:
    """
    Execute a skill in a scene, and read every tick from the recorded bag.

    :param scene: MJCF file with the sites ``tcp`` and ``lip`` and the tray
    :param folder: for skill, bag and logs; replaced
    :param rotational: K_o [Nm/rad]
    :returns: reference, pose, stiffness, joints, height of the lip and contacts with the tray
    :raises GdmpError: if the goal is not reached
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    skill.save(folder / 'skill.json')
    with process_bed(NodeTestbed, folder) as testbed:
        testbed.start({'model': str(scene.resolve())}, {
            'skill': str((folder / 'skill.json').resolve()),
            'rotational_stiffness': [rotational] * 3})
        testbed.spend(1.0)
        testbed.client.execute()
        testbed.client.result(60.0)
        testbed.spend(_TAIL_S)
        run = testbed.recorded()
        testbed.client.check_failure()
    return _by_tick(run, scene)


def _by_tick(run: Run, scene: Path) -> Data:
    """Arm and applied reference at every tick from the start of the motion."""
    begin = int(np.searchsorted(run.state_stamps,
                                run.reference_stamps[int(np.argmax(run.moving))]))
    at = np.searchsorted(run.sequences, run.applied[begin:])
    data = {'reference': run.references[np.minimum(at, len(run.references) - 1)],
            'pose': run.poses[begin:],
            'stiffness': run.stiffness[begin:].reshape(-1, 6, 6)[:, :3, :3],
            'joints': run.joints[begin:]}
    arm, lip, contacts = Arm(scene), [], []
    for q in data['joints']:
        arm.reset(q)
        lip.append(arm.site_pose('lip')[2])
        contacts.append(contact_count(arm.model, arm.data, 'tray'))
    return {**data, 'lip': np.array(lip), 'contacts': np.array(contacts)}

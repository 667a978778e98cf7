"""Names that users choose from; imports little, so that ``gdmp --help`` is fast."""
from gdmp_ros.errors import DataError

#: Connections of the transport of frames: exact, or as in [GDMP] section 4.
CONNECTIONS = ('parallel', 'published')
#: What learning fits: the motion (output), or the forcing term as in [GDMP].
FITS = ('output', 'forcing')
#: How a motion ends: at rest at its goal, or as it was demonstrated.
ENDS = ('rest', 'moving')
#: Sources of the stiffness of a skill; see `gdmp_ros.data.recordings.with_stiffness`.
STIFFNESSES = ('auto', 'recorded', 'variance', 'none')
#: Arms that a command may start; the first ones take torques.
TORQUE_ARMS = ('sim', 'franka')
ARMS = (*TORQUE_ARMS, 'ur5e')
#: Storage plugins of rosbag2.
STORAGES = ('mcap', 'sqlite3')
#: Classes of the LASA handwriting data set.
LASA_CLASSES = (
    'Angle', 'BendedLine', 'CShape', 'DoubleBendedLine', 'GShape', 'heee', 'JShape', 'JShape_2',
    'Khamesh', 'Leaf_1', 'Leaf_2', 'Line', 'LShape', 'NShape', 'PShape', 'RShape', 'Saeghe',
    'Sharpc', 'Sine', 'Snake', 'Spoon', 'Sshape', 'Trapezoid', 'Worm', 'WShape', 'Zshape',
    'Multi_Models_1', 'Multi_Models_2', 'Multi_Models_3', 'Multi_Models_4')
#: Manifolds of the Riemannian LASA data set.
LASA_MANIFOLDS = ('R2', 'S2', 'S3', 'SO3', 'SPD2')
#: Another mapping to SPD(2): the covariances of a class over time.
LASA_COVARIANCES = 'covariances'
#: Skills of the gallery.
GALLERY = ('letter-G', 'letter-S', 'pick-and-place', 'polish', 'screw', 'sphere', 'rotation',
           'covariance')
#: Tasks of the demonstration.
TASKS = ('letter', 'pick', 'clutter', 'joints', 'objects', 'wipe', 'tray')
#: What two arms, or two factors of a skill, keep: `gdmp_ros.dmp.coupling.Coupling`.
COUPLINGS = ('pose', 'relative', 'distance')
#: How an improvement searches, and its tasks that are built in.
SEARCHES = ('pibb', 'cma')
TASKS_TO_IMPROVE = ('insertion',)


def check_lasa_class(name: str) -> None:
    """:raises DataError: unless it is a class of the LASA data set; the message lists them"""
    if name not in LASA_CLASSES:
        raise DataError(f'LASA class {name!r} is unknown, expected one of '
                        f'{", ".join(LASA_CLASSES)}')
#: What happens to the size of a motion between task frames (`gdmp_ros.dmp.changes.with_frames`).
SCALES = ('none', 'distance')
#: What an array of another program can be.
ROLES = ('times', 'points', 'position', 'orientation', 'stiffness', 'joints')
#: Other ways to write a rotation than a quaternion: a rotation vector, or angles about axes; axes
#: in capitals turn with the body, others do not.
ROTATIONS = ('rotvec', 'xyz', 'XYZ', 'zyx', 'ZYX')
#: Suffixes of sequence files.
SEQUENCES = ('.yaml', '.yml')

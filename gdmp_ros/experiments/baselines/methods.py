"""The list of compared methods, in the order of the tables."""
from gdmp_ros.experiments.baselines.classical import Classical
from gdmp_ros.experiments.baselines.log_error import LogError
from gdmp_ros.experiments.baselines.ours import Ours, Published
from gdmp_ros.experiments.baselines.quaternion import AbuDakkaQuaternion, UdeQuaternion
from gdmp_ros.experiments.baselines.rotation import UdeRotation
from gdmp_ros.experiments.baselines.transported import TransportedAlong, TransportedToStart

METHODS = (Ours, Published, Classical, UdeQuaternion, UdeRotation, AbuDakkaQuaternion, LogError,
           TransportedToStart, TransportedAlong)

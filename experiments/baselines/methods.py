"""The list of compared methods, in the order of the tables."""
from experiments.baselines.classical import Classical
from experiments.baselines.log_error import LogError
from experiments.baselines.ours import Ours, Published
from experiments.baselines.quaternion import AbuDakkaQuaternion, UdeQuaternion
from experiments.baselines.rotation import UdeRotation
from experiments.baselines.transported import TransportedAlong, TransportedToStart

METHODS = (Ours, Published, Classical, UdeQuaternion, UdeRotation, AbuDakkaQuaternion, LogError,
           TransportedToStart, TransportedAlong)

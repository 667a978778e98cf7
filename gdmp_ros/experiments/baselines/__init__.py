"""
The methods [GDMP] compares with, from their published equations, and ours with the same interface.

One file each; what they share is in ``baseline.py``.
"""
from gdmp_ros.experiments.baselines.baseline import Baseline
from gdmp_ros.experiments.baselines.classical import Classical
from gdmp_ros.experiments.baselines.log_error import LogError, LogErrorShorter
from gdmp_ros.experiments.baselines.ours import Ours, Published
from gdmp_ros.experiments.baselines.quaternion import AbuDakkaQuaternion, UdeQuaternion
from gdmp_ros.experiments.baselines.rotation import UdeRotation
from gdmp_ros.experiments.baselines.transported import TransportedAlong, TransportedToStart

METHODS = (Ours, Published, Classical, UdeQuaternion, UdeRotation, AbuDakkaQuaternion, LogError,
           TransportedToStart, TransportedAlong)

__all__ = ['METHODS', 'AbuDakkaQuaternion', 'Baseline', 'Classical', 'LogError',
           'LogErrorShorter', 'Ours', 'Published', 'TransportedAlong', 'TransportedToStart',
           'UdeQuaternion', 'UdeRotation']

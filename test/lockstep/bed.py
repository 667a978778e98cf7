"""A testbed whose nodes and clients run in lockstep, in this process."""
from contextlib import contextmanager
import os
from unittest import mock

import rclpy

from gdmp_ros.ros.dds import using
from test.lockstep.children import LockstepChildren
from test.lockstep.network import Network

#: Nodes in lockstep use nothing of DDS: they look for no other participants.
_OFF = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'}


def isolated_context():
    """A context of rclpy whose nodes look for no others."""
    context = rclpy.Context()
    with mock.patch.dict(os.environ, _OFF):
        rclpy.init(context=context, args=[])
    return context


@contextmanager
def network():
    """A network that nodes and clients join meanwhile."""
    context = isolated_context()
    made = Network(context)
    try:
        with using(made):
            yield made
    finally:
        rclpy.shutdown(context=context)


@contextmanager
def lockstep_bed(kind, *arguments, makers=None, **options):
    """
    A `NodeTestbed` in lockstep.

    :param kind: the class; gets ``children`` and no environment
    :param makers: gets the network, and returns what `LockstepChildren` takes
    """
    with network() as made:
        children = LockstepChildren(made, None if makers is None else makers(made))
        with kind(*arguments, environment={}, children=children, **options) as bed:
            bed.network = made
            yield bed

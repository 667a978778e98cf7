"""The robots on which the control tests run: the model itself, and some that are not the model."""
from dataclasses import replace
from typing import NamedTuple

import pytest

from gdmp_ros.control.settings import ControllerSettings, FrictionSettings
from gdmp_ros.sim.arm import Arm
from gdmp_ros.sim.closed_loop import ClosedLoop
from gdmp_ros.sim.plant import PlantSettings, REAL

#: Shortest lever of a joint that matters at the tool [m].
LEVER = 0.2


class Plant(NamedTuple):
    """
    A robot, and what its controller knows of it.

    :ivar settings: how it differs from the model; None if it does not
    :ivar dry: friction that was identified [Nm]
    :ivar weight: that nobody announced [N]
    """

    settings: PlantSettings | None = None
    dry: float = 0.0
    weight: float = 0.0

    def arm(self, source=''):
        return Arm(source, plant=self.settings)

    def loop(self, source='', **settings):
        """A closed loop; ``settings`` are those of the controller."""
        return ClosedLoop(self.arm(source), ControllerSettings(
            **{'friction': FrictionSettings(dry=(self.dry,)), **settings}))

    def slack(self, stiffness=400.0):
        """How far from its reference friction and weight may hold it [m]."""
        return (self.weight + self.dry / LEVER) / stiffness


CLEAN = Plant()
PLANTS = {'clean': CLEAN, 'real': Plant(REAL, 1.1),
          'loaded': Plant(replace(REAL, payload=0.5), 1.1, 0.5 * 9.81)}


def on_plants(*names):
    """Run a test on some of the plants; all but the clean one take long."""
    return pytest.mark.parametrize('plant', [
        pytest.param(PLANTS[name], id=name, marks=() if name == 'clean' else pytest.mark.long)
        for name in names])


#: For all control tests in which a robot moves.
on_every_plant = on_plants(*PLANTS)

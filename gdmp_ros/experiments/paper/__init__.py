"""
The experiments of [GDMP], one module each, all alike.

A module has

- ``CLAIM``: what the paper shows, and ``SOURCE``: where;
- ``run(settings) -> Data``: the experiment; arrays by name, kept as ``{id}.npz``;
- ``verdict(data) -> Verdict``: whether the claim holds, and the figures that say so;
- ``draw(data) -> dict``: pictures by name, each beginning with the id.

``gdmp_ros.experiments.paper.report`` runs them and writes the report. The methods the paper compares with are
in ``baselines/``.
"""
from gdmp_ros.experiments.paper.experiment import Data, IDS, Settings, Verdict

__all__ = ['Data', 'IDS', 'Settings', 'Verdict']

"""
The experiments of [GDMP], one module each, with the same interface.

A module has

- ``CLAIM``: the claim of the paper, and ``SOURCE``: its place;
- ``run(settings) -> Data``: the experiment; arrays by name, stored as ``{id}.npz``;
- ``verdict(data) -> Verdict``: whether the claim holds, with the measured figures;
- ``draw(data) -> dict``: pictures by name; each name begins with the id.

`report` runs them and writes the report. The compared methods are in the folder ``baselines``.
"""

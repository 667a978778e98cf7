"""
Benchmarks of `python -m experiments bench`, one module each.

A module has ``TITLE``, ``run(settings) -> dict`` (written by ``--json``), ``rows(document)`` (the
table: heading, then lines) and optionally ``draw(document, axes)``. Other libraries are measured
in the same run, in the same process, on the same core.
"""

"""
What `gdmp bench` measures: one module each, all alike.

A module has ``TITLE``, ``run(settings) -> dict`` (what ``--json`` writes), ``rows(document)`` (the
table: heads, then lines) and, where there is something to see, ``draw(document, axes)``.
Peers are measured in the same run, in the same process, on the same core.
"""

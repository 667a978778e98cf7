"""Teach, see, change and run a skill in a browser: the only package that imports viser."""

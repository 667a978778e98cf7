"""Teach, see, change and run a skill in a browser: the only room that imports viser."""

"""Faults, load and bad networks, tried on the nodes as processes."""

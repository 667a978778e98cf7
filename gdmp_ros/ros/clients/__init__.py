"""Clients of the nodes: execution, teaching, dashboard."""

"""Simulated robots: the only place that imports MuJoCo."""

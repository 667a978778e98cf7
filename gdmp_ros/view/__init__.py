"""Figures, reports and films."""

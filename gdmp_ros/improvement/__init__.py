"""Improvement of skills from reward: search, what varies, tasks, roll-outs."""

"""Benchmarks, experiments of the paper, the demonstration, reliability."""

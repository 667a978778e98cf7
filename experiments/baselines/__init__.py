"""
The methods that [GDMP] compares with, from their published equations, and ours.

One file each; all have the interface of `experiments.baselines.baseline.Baseline`.
"""

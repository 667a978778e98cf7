"""One file for each verb of ``python -m experiments``."""

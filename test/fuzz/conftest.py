"""
How fuzzing chooses its inputs.

Others in every run, and first those that failed before (``.hypothesis``); always the same ones
where the variable CI is set.
"""
import os

from hypothesis import HealthCheck, settings

settings.register_profile('fuzz', deadline=None, suppress_health_check=list(HealthCheck))
settings.register_profile('fuzz-ci', settings.get_profile('fuzz'), derandomize=True,
                          database=None)
settings.load_profile('fuzz-ci' if 'CI' in os.environ else 'fuzz')

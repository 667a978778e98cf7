"""All faults, in the order of the table."""
from __future__ import annotations

from collections.abc import Callable
import importlib

from experiments.reliability.trial import FaultTrial
from experiments.reliability.trial_result import TrialResult

Fault = Callable[[FaultTrial, bool], TrialResult]
#: Name, and module and function of its trial.
FAULTS = {
    'server-killed': 'processes.server_killed',
    'simulation-killed': 'processes.simulation_killed',
    'server-stopped': 'processes.server_stopped',
    'late-discovery': 'processes.late_discovery',
    'restarts': 'processes.restarts',
    'two-servers': 'processes.two_servers',
    'stands-still': 'following.stands_still',
    'teaching-ends': 'following.teaching_ends',
    'out-of-reach': 'following.out_of_reach',
    'moved-while-inactive': 'following.moved_while_inactive',
    'reference-jumps': 'following.reference_jumps',
    'skill-file': 'files.skill_file',
    'bag-file': 'files.bag_file',
    'disk-full': 'files.disk_full',
    'simulated-clock': 'clocks.simulated_clock',
    'mixed-clocks': 'clocks.mixed_clocks',
    'wall-clock': 'clocks.wall_clock',
    'goal-flood': 'traffic.goal_flood',
    'garbage-flood': 'traffic.garbage_flood',
    'two-hosts': 'hosts.good_network',
    'lossy-network': 'hosts.lossy_network',
    'slow-network': 'hosts.slow_network',
    'network-cut': 'hosts.network_cut',
    'adversarial-stiffness': 'energy.adversarial_stiffness',
}


def fault(name: str) -> Fault:
    """FaultTrial of a fault; its docstring describes it."""
    module, function = FAULTS[name].split('.')
    trials = importlib.import_module(f'{__name__}.{module}')
    found: Fault = getattr(trials, function)
    return found

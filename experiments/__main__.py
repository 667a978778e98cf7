"""``python -m experiments VERB``, in the folder of the project."""
from gdmp_ros.cli.program import Program

PROGRAM = Program('python -m experiments', 'experiments.cli', 'Measure what the project claims.', {
    'experiments': {
        'bench': 'measure speed, accuracy and smoothness, compared with other libraries',
        'paper': 'reproduce the experiments of the paper',
        'faults': 'try faults on the nodes',
        'soak': 'operate the nodes for a long time and watch them',
        'limits': 'try the control of an arm at its limits',
        'obstacles': 'put things in the way of skills and of an arm',
        'film': 'make the film of the first page from recorded runs',
        'franka': 'let a Franka follow a letter again and again, over its protocol',
        'edges': 'try learning where data are bad',
        'requests': 'try random sequences of requests to a server and to an arm',
    }})

if __name__ == '__main__':
    raise SystemExit(PROGRAM.main())

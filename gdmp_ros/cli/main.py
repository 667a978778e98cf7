"""The verbs of ``gdmp``."""
from __future__ import annotations

from collections.abc import Sequence

from gdmp_ros.cli.program import Program

#: Verbs by purpose, with their help; the module of a verb has its name.
GROUPS = {
    'demonstrations': {
        'record': 'write demonstrations from a data set: rosbag2, or on a manifold',
        'teach': 'guide a simulated arm by hand and record takes',
        'takes': 'list and compare takes of a demonstration, drop outliers',
        'convert': 'convert demonstrations and skills from and to other formats',
    },
    'skills': {
        'learn': 'learn a skill from rosbag2 demonstrations',
        'tune': 'suggest basis functions, gains, stiffness and limits',
        'couple': 'make one skill of two arms from two skills',
        'improve': 'improve a skill by trying, from the cost of roll-outs',
        'refine': 'correct a skill where the arm was pushed, or undo that',
        'inspect': 'show the contents of a bag or a skill file',
        'plot': 'draw a skill',
        'check': 'check whether an arm can follow a skill',
        'rollout': 'roll a skill out, to another goal if asked, as CSV',
        'studio': 'teach, see, change and run a skill in a browser',
        'gallery': 'make a gallery of skills with pictures',
    },
    'robot': {
        'demo': 'everything end to end on a simulated Panda',
        'up': 'start a simulated arm, server and recorder until Ctrl-C',
        'execute': 'execute the skill of a running server, switch its goal',
        'replay': 'send recorded references to an arm again',
        'watch': 'watch server and arm in the terminal',
        'report': 'make an HTML page about a bag',
        'film': 'make a film of a run, or of a skill',
        'describe': 'write the URDF of an arm',
        'home': 'move the joints of an arm to a posture',
        'identify-friction': "measure the friction of an arm's joints",
        'doctor': 'check this machine and say what to change',
        'warm-up': 'compile the kernels now, not at the first start',
    },
}
_EXAMPLES = """\
a first skill, from handwriting to a motion:
  gdmp record lasa GShape -o demos          write 7 demonstrations as rosbag2
  gdmp inspect demos/GShape_1               look at one
  gdmp learn demos/GShape_* -o skill.json   learn pose and stiffness from all
  gdmp plot skill.json -o skill.png         see it
  gdmp rollout skill.json --goal-position 0.5 0.1 0.4

your own skill, in simulation:
  gdmp teach -o takes                       guide the arm by hand, a few takes
  gdmp takes takes                          compare them, drop outliers
  gdmp tune takes                           how to learn from them
  gdmp learn takes -o skill.json
  gdmp execute --load skill.json            on running nodes (panda_sim, trajectory_server)

everything on a simulated robot:
  gdmp demo

gdmp VERB --help describes a verb, with examples. Completion in bash or zsh:
  eval "$(register-python-argcomplete gdmp)"
"""
PROGRAM = Program('gdmp', 'gdmp_ros.cli',
                  'Learn robot skills from demonstrations and roll them out.', GROUPS, _EXAMPLES)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb; see `Program.main`."""
    return PROGRAM.main(arguments)

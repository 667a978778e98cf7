"""The verbs of ``gdmp``."""
from __future__ import annotations

from collections.abc import Sequence

from gdmp_ros.cli.program import Program

#: Verbs by purpose, with their help; the module of a verb has its name.
GROUPS = {
    'demonstrations': {
        'record': 'guide a simulated arm and record takes',
        'takes': 'list and compare takes, drop outliers',
        'convert': 'convert demonstrations and skills from and to other formats',
        'examples lasa': 'write handwriting of people as demonstrations',
    },
    'skills': {
        'learn': 'learn a skill from demonstrations, or suggest how',
        'show': 'show a recording or a skill: as text, picture, film or page',
        'check': 'check whether an arm can follow a skill',
        'rollout': 'roll a skill out, to another goal if asked, as CSV',
        'edit couple': 'make one skill of two arms from two skills',
        'edit refine': 'correct a skill where the arm was pushed, or undo that',
        'improve': 'improve a skill by trying, from the cost of roll-outs',
        'studio': 'teach, see, change and run a skill in a browser',
        'examples skills': 'make a gallery of skills with pictures',
    },
    'robot': {
        'demo': 'everything end to end on a simulated Panda',
        'up': 'start a simulated arm, server and recorder until Ctrl-C',
        'run': 'run a skill, a sequence or a recorded run on running nodes',
        'watch': 'watch server and arm in the terminal',
        'home': 'move the joints of an arm to a posture',
        'arm model': 'make a model of an arm from its URDF',
        'arm urdf': 'write the URDF of an arm',
        'arm friction': "measure the friction of an arm's joints",
        'arm tool': 'weigh the tool of an arm that takes joint positions',
        'doctor': 'check this machine, or compile the kernels',
    },
}
#: What other programs, or a first guess, call a verb.
SYNONYMS = {'teach': 'record', 'inspect': 'show', 'plot': 'show', 'film': 'show',
            'report': 'show', 'info': 'show', 'view': 'show', 'execute': 'run', 'replay': 'run',
            'play': 'run', 'couple': 'edit couple', 'refine': 'edit refine',
            'describe': 'arm urdf', 'identify-friction': 'arm friction',
            'tune': 'learn --suggest', 'warm-up': 'doctor --compile',
            'gallery': 'examples skills', 'lasa': 'examples lasa', 'train': 'learn'}
_EXAMPLES = """\
a first skill:                              your own, in simulation:
  gdmp examples lasa GShape -o demos          gdmp record -o takes
  gdmp learn demos -o skill.json              gdmp learn takes --suggest
  gdmp show skill.json -o skill.png           gdmp learn takes -o skill.json
everything on a simulated robot:              gdmp up skill.json    (and, beside it:)
  gdmp demo                                   gdmp run

gdmp VERB --help describes a verb, with examples. Completion in bash or zsh:
  eval "$(register-python-argcomplete gdmp)"
"""
PROGRAM = Program('gdmp', 'gdmp_ros.cli',
                  'Learn robot skills from demonstrations and roll them out.', GROUPS, _EXAMPLES,
                  SYNONYMS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a verb; see `Program.main`."""
    return PROGRAM.main(arguments)

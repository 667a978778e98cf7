"""Make a small gallery of skills: skill files, pictures, and a page that shows them.

The skills are learned from handwriting and from computed motions. Use one as a first example: play
it, read its file, switch its goals.

examples:
  gdmp examples skills -o gallery
  gdmp examples skills pick-and-place -o gallery
  gdmp show gallery/pick-and-place.json -o pick.mp4
"""
from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from gdmp_ros.choices import GALLERY
from gdmp_ros.cli.arguments import add_output
from gdmp_ros.errors import DataError
from gdmp_ros.util.terminal import progress

if TYPE_CHECKING:
    from gdmp_ros.dmp.skill import Skill


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('names', nargs='*', metavar='NAME',
                        help=f'some of {", ".join(GALLERY)}; all by default')
    add_output(parser, 'DIR', 'folder for the skills NAME.json, pictures NAME.png and index.md')


def run(options: argparse.Namespace) -> None:
    """Learn, draw, write."""
    names = options.names or list(GALLERY)
    for name in names:
        if name not in GALLERY:
            raise DataError(f'{name!r} is not in the gallery, expected one of '
                            f'{", ".join(GALLERY)}')
    from gdmp_ros.data import gallery
    from gdmp_ros.util.files import write_text
    from gdmp_ros.view import plots, skill_plots
    learned = {}
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        with progress('learning and drawing', len(names)) as step:
            for name in names:
                learned[name] = gallery.learned(name)
                learned[name].save(options.output / f'{name}.json')
                plots.save(skill_plots.skill_figure(learned[name]), options.output / f'{name}.png')
                step()
        write_text(options.output / 'index.md', page(learned))
    except OSError as error:
        raise DataError(f'{options.output}: cannot write: {error.strerror}') from None
    count = 'a skill' if len(names) == 1 else f'{len(names)} skills'
    print(f'wrote {count}, pictures and {options.output / "index.md"}')


def page(learned: dict[str, Skill]) -> str:
    """Page that shows skills, with the pictures next to it."""
    from gdmp_ros.data.gallery import EXAMPLES
    lines = ['# Gallery', '', 'Made by `gdmp examples skills`. Each skill is a file, '
             '`NAME.json`: play it, read it, change it.', '']
    for name, skill in learned.items():
        example = EXAMPLES[name]
        lines += [f'## {example.title}: `{name}`', '',
                  f'{example.shows[0].upper()}{example.shows[1:]}. On {skill.manifold!r}, '
                  f'{skill.duration:.1f} s, {skill.n_basis} basis functions.', '',
                  f'![{example.title}]({name}.png)', '']
    return '\n'.join(lines)

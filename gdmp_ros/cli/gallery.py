"""Make a small gallery of skills: skill files, pictures, and a page that shows them.

The skills are learned on the spot, from handwriting that people have written and from motions that
are made up. Take one to begin with: play it, look into its file, switch its goals.

examples:
  gdmp gallery -o gallery
  gdmp gallery pick-and-place -o gallery
  gdmp film gallery/pick-and-place.json -o pick.mp4
"""
from __future__ import annotations

import argparse
from pathlib import Path

from gdmp_ros.data import gallery
from gdmp_ros.dmp import Skill
from gdmp_ros.errors import DataError
from gdmp_ros.util.atomic_write import write_text
from gdmp_ros.util.terminal import progress
from gdmp_ros.view import plots

HELP = 'make a gallery of skills with pictures'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument('names', nargs='*', metavar='NAME',
                        help=f'some of {", ".join(gallery.PIECES)}; all by default')
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='DIR',
                        help='folder for the skills NAME.json, pictures NAME.png and index.md')


def run(options: argparse.Namespace) -> None:
    """Learn, draw, write."""
    names = options.names or list(gallery.PIECES)
    for name in names:
        if name not in gallery.PIECES:
            raise DataError(f'{name!r} is not in the gallery, expected one of '
                            f'{", ".join(gallery.PIECES)}')
    made = {}
    try:
        options.output.mkdir(parents=True, exist_ok=True)
        with progress('learning and drawing', len(names)) as step:
            for name in names:
                made[name] = gallery.learned(name)
                made[name].save(options.output / f'{name}.json')
                plots.save(skill_plots.skill_figure(made[name]), options.output / f'{name}.png')
                step()
        write_text(options.output / 'index.md', page(made))
    except OSError as error:
        raise DataError(f'{options.output}: cannot write: {error.strerror}') from None
    print(f'wrote {len(names)} skills, pictures and {options.output / "index.md"}')


def page(made: dict[str, Skill]) -> str:
    """Page that shows skills, with pictures beside it."""
    lines = ['# Gallery', '', 'Made by `gdmp gallery`: each skill is a file, `NAME.json`, to '
             'play, to read and to change.', '']
    for name, skill in made.items():
        piece = gallery.PIECES[name]
        lines += [f'## {piece.title}: `{name}`', '',
                  f'{piece.shows[0].upper()}{piece.shows[1:]}. On {skill.manifold!r}, '
                  f'{skill.duration:.1f} s, {skill.n_basis} basis functions.', '',
                  f'![{piece.title}]({name}.png)', '']
    return '\n'.join(lines)

"""Pages as HTML files that need no network."""
from __future__ import annotations

from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader

from gdmp_ros import __version__
from gdmp_ros.errors import DataError
from gdmp_ros.util.atomic_write import write_text
from gdmp_ros.view.report_figures import library


def write_page(template: str, path: Path, what: str, **parts: Any) -> None:
    """
    Write a page, whole or not at all.

    :param template: file beside this one that extends ``page.html``
    :param what: the page is, for the message
    :param parts: of the template
    :raises DataError: if it cannot be written
    """
    page = Environment(loader=PackageLoader('gdmp_ros.view', '.'), autoescape=True)
    text = page.get_template(template).render(library=library(), version=__version__, **parts)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
    except OSError as error:
        raise DataError(f'{path}: cannot write the {what}: {error.strerror}') from None

"""The templates of the pages, in the folder `templates`, and how they are filled: the one Jinja environment.

Values are escaped, and their invisible characters are made visible; a name that isn't there, and None, are errors.
"""

from __future__ import annotations

import base64
import hashlib
import math
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from rcdn.report.calibration import formats
from rcdn.report.calibration.svg import data_uri, escape, visible

if TYPE_CHECKING:
    from jinja2 import Environment

FOLDER = Path(__file__).with_name("templates")
STYLES = ("page.css", "drawings.css", "pictures.css", "screens.css")
"""the style sheet, in the order of its cascade"""
SCRIPTS = ("copy.js", "enlarge.js", "turn.js")
"""the script; without it the page has the same content, but is static"""


def render(template: str, **payload: object) -> str:
    """The text of `template`, a file's name without .html.jinja, filled with `payload`."""
    return environment().get_template(f"{template}.html.jinja").render(payload)


@cache
def environment() -> Environment:
    """The environment of all templates. Jinja is imported with the first page."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    made = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        auto_reload=False,
        finalize=shown,
    )
    texts = (formats.number, formats.pixels, formats.bare_pixels, formats.percent, formats.counted, formats.thousands)
    made.filters |= {text.__name__: text for text in (*texts, formats.short, data_uri, lines)}
    made.tests["finite"] = math.isfinite
    made.globals |= {"style": sheet(), "script": script(), "policy": policy()}
    return made


def shown(value: object) -> object:
    """What a template shows of `value`: markup as it is, other values as text without invisible characters."""
    if value is None:
        raise TypeError("a template shows a value that is None")
    return value if isinstance(value, Markup) else visible(str(value))


def lines(text: str) -> Markup:
    """`text` for an element that keeps line breaks."""
    return Markup("\n".join(escape(line) for line in text.split("\n")))


@cache
def sheet() -> Markup:
    """The style sheet of all pages."""
    return _files(STYLES)


@cache
def script() -> Markup:
    """The script of all pages."""
    return _files(SCRIPTS)


@cache
def policy() -> str:
    """The content security policy: embedded pictures only, and no script except `script()`."""
    digest = base64.b64encode(hashlib.sha256(script().encode()).digest()).decode()
    return (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; "
        f"script-src 'sha256-{digest}'"
    )


def _files(names: tuple[str, ...]) -> Markup:
    return Markup("\n" + "".join((FOLDER / name).read_text("utf-8") for name in names))

"""Drawings: elements of SVG with escaping of all text, paths, and what a template shows of a drawing."""

from __future__ import annotations

import base64
import re
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from markupsafe import escape as _escape

from rcdn.report.calibration.formats import coordinate
from rcdn.types import Array

_INVISIBLE = re.compile(
    "[\x00-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufdd0-\ufdef\ufffe\uffff]"
)


@dataclass(frozen=True)
class Drawing:
    """What a template shows as a figure: `art`, an SVG; the `marks` of its legend, (description, shapes in a box of
    18 × 14 units); `caption`, a sentence on what is seen in it; a `note` on what isn't drawn; `turns`: a script can
    rotate it."""

    art: Markup
    marks: tuple[tuple[str, Markup], ...] = ()
    caption: str = ""
    note: str = ""
    turns: bool = False


def visible(text: str) -> str:
    """`text` with its invisible characters made visible (a line break is ␊), so that a file's name can't hide or
    reverse its letters; unpaired surrogates, as in names that aren't UTF-8, are written as \\udcff."""
    seen = _INVISIBLE.sub(lambda m: _visible(m[0]), text)
    return seen.encode("utf-8", "backslashreplace").decode()


def _visible(letter: str) -> str:
    return chr(0x2400 + ord(letter)) if letter < " " else letter.encode("unicode_escape").decode()


def escape(text: object) -> Markup:
    """`text` as markup, for an element or a quoted attribute, with invisible characters made visible."""
    return text if isinstance(text, Markup) else _escape(visible(str(text)))


def tag(name: str, /, *children: object, **attributes: object) -> Markup:
    """An element; children are escaped unless they are markup. `class_` gives the attribute class, `aria_label`
    aria-label; None omits an attribute."""
    words = []
    for key, value in attributes.items():
        if value is not None:
            shown = coordinate(float(value)) if isinstance(value, (float, np.floating)) else value
            words.append(f' {key.rstrip("_").replace("_", "-")}="{escape(shown)}"')
    return Markup(f"<{name}{''.join(words)}>{join(*children)}</{name}>")


def join(*children: object) -> Markup:
    """The concatenated children, escaped unless they are markup; None is omitted."""
    return Markup("".join(escape(c) for c in children if c is not None))


def each(items: list[Markup]) -> Markup:
    """The concatenated elements, one per line."""
    return Markup("\n".join(items))


def data_uri(jpeg: bytes) -> Markup:
    """A JPEG as a data URI."""
    return Markup("data:image/jpeg;base64," + base64.b64encode(jpeg).decode())


def dots(xy: Array, decimals: int = 1) -> str:
    """A path with one point for each row of (N, 2), drawn as discs by round line caps; a fifth of the length of
    circles."""
    return "".join(f"M{coordinate(x, decimals)} {coordinate(y, decimals)}h0" for x, y in xy)


def crosses(xy: Array, half: float, decimals: int = 1) -> str:
    """A path with a diagonal cross of half width `half` for each row of (N, 2)."""
    h, t = coordinate(half, decimals), coordinate(2 * half, decimals)
    return "".join(
        f"M{coordinate(x, decimals)} {coordinate(y, decimals)}m-{h} -{h}l{t} {t}m0-{t}l-{t} {t}" for x, y in xy
    )


def rings(xy: Array, radius: float, decimals: int = 1) -> str:
    """A path with a circle of `radius` around each row of (N, 2)."""
    r, d = coordinate(radius, decimals), coordinate(2 * radius, decimals)
    arc = f"a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0"
    return "".join(f"M{coordinate(x - radius, decimals)} {coordinate(y, decimals)}{arc}" for x, y in xy)


def segments(start: Array, end: Array) -> str:
    """A path with a straight line for each row, from `start` (N, 2) to `end` (N, 2)."""
    f = coordinate
    return "".join(f"M{f(a)} {f(b)}L{f(c)} {f(d)}" for (a, b), (c, d) in zip(start, end, strict=True))


def polyline(xy: Array) -> str:
    """A path through the rows of (N, 2), not closed; empty without rows."""
    through = "L".join(f"{coordinate(x)} {coordinate(y)}" for x, y in xy)
    return f"M{through}" if through else ""


def outline(xy: Array) -> str:
    """A closed path through the rows of (N, 2); empty without rows."""
    return f"{polyline(xy)}z" if len(xy) else ""

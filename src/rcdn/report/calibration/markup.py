"""HTML that can't be broken by what is written into it, and numbers as people read them."""

from __future__ import annotations

import base64
import re
from html import escape as _escape

import numpy as np

from rcdn.types import Array

VOID = frozenset({"img", "meta", "link", "br"})
DASH = "–"
"""stands for a number that isn't known"""
_UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufdd0-\ufdef\ufffe\uffff]"
)


class Html(str):
    """Text that is HTML already; every other text is escaped on its way into a tag."""

    __slots__ = ()


def escape(text: object) -> Html:
    """`text` as HTML, in an element or between quotes. What can't be seen is made visible (a line break is ␊), so that a file's
    name can't hide or turn round its letters; halves of surrogate pairs, as in names that aren't UTF-8, are written as \\udcff."""
    if isinstance(text, Html):
        return text
    seen = _UNSEEN.sub(lambda m: _visible(m[0]), str(text))
    return Html(_escape(seen.encode("utf-8", "backslashreplace").decode(), quote=True))


def _visible(letter: str) -> str:
    return chr(0x2400 + ord(letter)) if letter < " " else letter.encode("unicode_escape").decode()


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """An element: children are escaped unless they are `Html`. `class_` is class, `aria_label` aria-label; None and False leave an
    attribute out, True names it only."""
    words = []
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        word = key.rstrip("_").replace("_", "-")
        shown = coordinate(float(value)) if isinstance(value, (float, np.floating)) else value
        words.append(f" {word}" if value is True else f' {word}="{escape(shown)}"')
    start = f"<{name}{''.join(words)}>"
    return Html(start if name in VOID else f"{start}{join(*children)}</{name}>")


def join(*children: object) -> Html:
    """Children one after another, escaped unless they are `Html`; None is nothing."""
    return Html("".join(escape(c) for c in children if c is not None))


def each(items: list[Html]) -> Html:
    """The elements one after another, one a line."""
    return Html("\n".join(items))


def coordinate(value: float, decimals: int = 1) -> str:
    """A number for a drawing, short: 12.0 is 12, −0.0 is 0."""
    text = f"{float(value):.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text


def number(value: float, digits: int = 3, sign: bool = False) -> str:
    """A number of about `digits` digits, never with an exponent between 0.001 and a million; a dash if it isn't finite."""
    value = float(value)
    if not np.isfinite(value):
        return DASH
    if value != 0 and not 1e-3 <= abs(value) < 1e6:
        text = f"{value:.{digits - 1}e}"
    else:
        whole = int(np.floor(np.log10(abs(value)))) if value else 0
        text = f"{value:.{max(digits - 1 - whole, 0)}f}"
    return ("+" if sign and value > 0 else "") + text.replace("-", "−")


def pixels(value: float) -> str:
    """A length in pixels: to a thousandth from 0.1 to 1, else to three digits."""
    if np.isfinite(value) and 0.1 <= abs(value) < 1:
        return f"{value:.3f} px".replace("-", "−")
    return f"{number(value)} px" if np.isfinite(value) else DASH


def percent(share: float) -> str:
    """A share as per cent: two digits below ten."""
    share = 100 * float(share)
    return f"{number(share, 2) if not abs(share) >= 10 else round(share)} %"


def value_and_std(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation: two digits of the deviation, and the value to the same place."""
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}".replace("-", "−"), DASH
    decimals = int(np.clip(1 - np.floor(np.log10(std)), 0, 12))
    return f"{value:.{decimals}f}".replace("-", "−"), f"{std:.{decimals}f}"


def counted(many: int, one: str, more: str = "") -> str:
    """`1 board`, `2 boards`, `1,234 corners`."""
    return f"{many:,} {one if many == 1 else more or one + 's'}"


def data_uri(jpeg: bytes) -> str:
    """A JPEG as the address of itself."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def dots(xy: Array, decimals: int = 1) -> str:
    """Path of one point for each row of (N, 2): drawn as discs with round line ends, a fifth of a circle's letters."""
    return "".join(f"M{coordinate(x, decimals)} {coordinate(y, decimals)}h0" for x, y in xy)


def crosses(xy: Array, half: float, decimals: int = 1) -> str:
    """Path of a slanting cross, `half` wide to each side, for each row of (N, 2)."""
    h, t = coordinate(half, decimals), coordinate(2 * half, decimals)
    return "".join(
        f"M{coordinate(x, decimals)} {coordinate(y, decimals)}m-{h} -{h}l{t} {t}m0-{t}l-{t} {t}" for x, y in xy
    )


def rings(xy: Array, radius: float, decimals: int = 1) -> str:
    """Path of a circle of `radius` around each row of (N, 2)."""
    r, d = coordinate(radius, decimals), coordinate(2 * radius, decimals)
    arc = f"a{r} {r} 0 1 0 {d} 0a{r} {r} 0 1 0-{d} 0"
    return "".join(f"M{coordinate(x - radius, decimals)} {coordinate(y, decimals)}{arc}" for x, y in xy)


def segments(start: Array, end: Array, decimals: int = 1) -> str:
    """Path of a straight line for each row, from `start` (N, 2) to `end` (N, 2)."""
    f = lambda v: coordinate(v, decimals)  # noqa: E731
    return "".join(f"M{f(a)} {f(b)}L{f(c)} {f(d)}" for (a, b), (c, d) in zip(start, end, strict=True))

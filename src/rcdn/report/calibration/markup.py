"""Generation of HTML with escaping of all text, and formatting of numbers for readers."""

from __future__ import annotations

import base64
import re
from html import escape as _escape

import numpy as np

from rcdn.types import Array

VOID = frozenset({"img", "meta", "link", "br"})
DASH = "–"
"""placeholder for an unknown number"""
_UNSEEN = re.compile(
    "[\x00-\x1f\x7f-\x9f\u00ad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufdd0-\ufdef\ufffe\uffff]"
)


class Html(str):
    """Text that is already HTML; all other text is escaped when it is put into a tag."""

    __slots__ = ()


def escape(text: object) -> Html:
    """`text` as HTML, for an element or a quoted attribute. Invisible characters are made visible (a line break is ␊),
    so that a file's name can't hide or reverse its letters; unpaired surrogates, as in names that aren't UTF-8, are
    written as \\udcff."""
    if isinstance(text, Html):
        return text
    seen = _UNSEEN.sub(lambda m: _visible(m[0]), str(text))
    return Html(_escape(seen.encode("utf-8", "backslashreplace").decode(), quote=True))


def _visible(letter: str) -> str:
    return chr(0x2400 + ord(letter)) if letter < " " else letter.encode("unicode_escape").decode()


def tag(name: str, /, *children: object, **attributes: object) -> Html:
    """An element; children are escaped unless they are `Html`. `class_` gives the attribute class, `aria_label`
    aria-label; None and False omit an attribute, True gives one without a value."""
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
    """The concatenated children, escaped unless they are `Html`; None is omitted."""
    return Html("".join(escape(c) for c in children if c is not None))


def each(items: list[Html]) -> Html:
    """The concatenated elements, one per line."""
    return Html("\n".join(items))


def coordinate(value: float, decimals: int = 1) -> str:
    """A number for a drawing in its shortest form: 12.0 is 12, −0.0 is 0."""
    text = f"{float(value):.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text


def number(value: float, digits: int = 3, sign: bool = False) -> str:
    """A number with about `digits` digits, without an exponent between 0.001 and a million; a dash if it isn't
    finite."""
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
    """A length in pixels: three decimals from 0.1 to 1, else three digits."""
    if np.isfinite(value) and 0.1 <= abs(value) < 1:
        return f"{value:.3f} px".replace("-", "−")
    return f"{number(value)} px" if np.isfinite(value) else DASH


def percent(share: float) -> str:
    """A fraction as a percentage, with two digits below ten."""
    share = 100 * float(share)
    return f"{number(share, 2) if not abs(share) >= 10 else round(share)} %"


def value_and_std(value: float, std: float) -> tuple[str, str]:
    """A value and its standard deviation: two digits of the deviation, and the value to the same decimal place."""
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}".replace("-", "−"), DASH
    decimals = int(np.clip(1 - np.floor(np.log10(std)), 0, 12))
    return f"{value:.{decimals}f}".replace("-", "−"), f"{std:.{decimals}f}"


def counted(many: int, one: str, more: str = "") -> str:
    """A count with its noun: `1 board`, `2 boards`, `1,234 corners`."""
    return f"{many:,} {one if many == 1 else more or one + 's'}"


def data_uri(jpeg: bytes) -> str:
    """A JPEG as a data URI."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


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


def segments(start: Array, end: Array, decimals: int = 1) -> str:
    """A path with a straight line for each row, from `start` (N, 2) to `end` (N, 2)."""
    f = lambda v: coordinate(v, decimals)  # noqa: E731
    return "".join(f"M{f(a)} {f(b)}L{f(c)} {f(d)}" for (a, b), (c, d) in zip(start, end, strict=True))

"""`--spacing`: a length with its unit, and the question back where one without makes a board of metres."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from rcdn.errors import ConfigError

UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "in": 0.0254, '"': 0.0254, "": 1.0}
"""m; a number alone is in metres"""
LARGEST = 2.0
"""m across: a larger board is believed only of a length with a unit"""
SMALLEST_BOARD = 3
"""squares that any board has across"""
LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-z\"]*)\s*")


class Length(float):
    """Metres, with the `text` that was given and whether that had a `unit`."""

    text: str
    unit: bool


def parse_length(text: str) -> Length:
    """`25mm`, `2.5cm`, `1in`, `0.025m`, or `0.025` (metres). Raises typer.BadParameter."""
    match = LENGTH.fullmatch(str(text))
    if match is None or match[2] not in UNITS:
        raise typer.BadParameter(f"{text!r} is not a length; give 25mm, 2.5cm, 1in, or metres: 0.025")
    # divided where that is exact: 25 / 1000 is the same as 0.025
    length = Length(float(match[1]) / 1000 if match[2] == "mm" else float(match[1]) * UNITS[match[2]])
    length.text, length.unit = str(text).strip(), bool(match[2])
    return length


def check_length(spacing: Length, size: tuple[int, int] | None = None) -> None:
    """Raise ConfigError unless `spacing` is positive and, if it has no unit, makes a board of `size` (inner corners) of at most 2 m across."""
    from rcdn.types.ranges import SPACING, in_words, is_spacing

    if not is_spacing(spacing):
        raise ConfigError(
            f"--spacing is the side of one square and must be above 0, {in_words(*SPACING)} m (25mm, or metres: 0.025), not {spacing.text}"
        )
    across = (SMALLEST_BOARD if size is None else max(size) + 1) * spacing
    if spacing.unit or across <= LARGEST:
        return
    board = "a board" if size is None else f"a {size[0]}×{size[1]} board"
    least = "at least " if size is None else ""
    raise ConfigError(
        f"--spacing {spacing.text} means metres and makes {board} {least}{across:.3g} m across; did you mean {_likely(spacing)}? "
        f"If it is so large, write {spacing.text}m"
    )


def _likely(spacing: Length) -> str:
    """The same number with the unit that makes a square of a usual size, and what that is in metres."""
    unit = "mm" if spacing >= 5 else "cm"
    return f"{spacing.text}{unit} ({spacing * UNITS[unit]:.6g})"


Spacing = Annotated[
    Length,
    typer.Option(
        parser=parse_length,
        metavar="LENGTH",
        help="Side of one square (or triangle), with its unit: 25mm, 2.5cm, 1in. A number alone is in metres: 0.025.",
    ),
]

"""Errors that rcdn raises on purpose. Each message names the argument and the fix."""

from __future__ import annotations

from typing import Any, TypeVar

T = TypeVar("T")

LONGEST = 60
"""characters of a value that a message shows"""


def shown(value: Any) -> str:
    """A value as messages show it: on one line, and cut where it is long, whatever it is."""
    try:
        if isinstance(value, int) and abs(value) >= 10**LONGEST:
            return f"a number of more than {LONGEST} digits"
        text = repr(value[: 2 * LONGEST] if isinstance(value, (str, bytes, list, tuple)) else value)
    except (ValueError, RecursionError):  # an integer too long to be written, or what holds one
        return f"a {type(value).__name__} that is too long to be shown"
    text = " ".join(text.split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def many(count: int, thing: str, things: str = "") -> str:
    """`1 picture`, `2 pictures`; `things` where it isn't `thing` and an s."""
    return f"{count} {thing if count == 1 else things or thing + 's'}"


def were_left_out(count: int) -> str:
    """What `count` of several things did, and what was done to them."""
    return f"{'disagrees' if count == 1 else 'disagree'} with the others and {'was' if count == 1 else 'were'} left out"


def a_board(size: tuple[int, int]) -> str:
    """`a 9×6 board`, `an 8×6 board`: of inner corners (columns, rows)."""
    article = "an" if str(size[0])[0] == "8" or size[0] in (11, 18) else "a"
    return f"{article} {size[0]}×{size[1]} board"


class RcdnError(Exception):
    """Base of every error raised on purpose by rcdn."""


class ImageError(RcdnError):
    """A picture that can't be read or can't be used (missing, truncated, empty, wrong shape, not finite)."""


class ConfigError(RcdnError, ValueError):
    """A setting that is unknown or outside its range."""


class FormatError(RcdnError):
    """A file of detections, cameras or a calibration that can't be read, or a result that its format can't hold."""


class OutputError(RcdnError):
    """A result that can't be written (no space, no permission, no such folder)."""


class DependencyError(RcdnError, ImportError):
    """An optional dependency is missing; the message says which extra brings it."""


class CalibrationError(RcdnError):
    """Boards that don't settle a camera, a pose or a pair of cameras; the message says what pictures to take."""


def present(value: T | None, what: str) -> T:
    """`value`, which is there. Raises RcdnError, naming `what`, if it is None: a guard that holds under `python -O`, too."""
    if value is None:
        raise RcdnError(f"{what} is missing")
    return value

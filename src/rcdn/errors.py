"""Errors that rcdn raises on purpose. Each message names the argument and the fix."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")

LONGEST = 60
"""largest number of characters of a value in a message"""


def shown(value: Any) -> str:
    """Text of any value for a message: on one line, and truncated if it is long."""
    try:
        if isinstance(value, int) and abs(value) >= 10**LONGEST:
            return f"a number of more than {LONGEST} digits"
        text = repr(value[: 2 * LONGEST] if isinstance(value, (str, bytes, list, tuple)) else value)
    except (ValueError, RecursionError):  # an integer too long to print, or a container of one
        return f"a {type(value).__name__} that is too long to be shown"
    text = " ".join(text.split())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


def many(count: int, thing: str, things: str = "") -> str:
    """`1 picture`, `2 pictures`; `things` where it isn't `thing` and an s."""
    return f"{count} {thing if count == 1 else things or thing + 's'}"


def two_digits(value: float) -> str:
    """Two significant digits or all before the decimal point: 0.12, 5.7, 203."""
    return f"{value:.2g}" if abs(value) < 99.5 else f"{value:.0f}"


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
    """A file of detections, cameras or a calibration that can't be read, or a result that a format can't represent."""


class OutputError(RcdnError):
    """A result that can't be written (no space, no permission, no such folder)."""


class DependencyError(RcdnError, ImportError):
    """An optional dependency is missing; the message names the extra that installs it."""


class CalibrationError(RcdnError):
    """Boards that don't determine a camera, a pose or a pair of cameras; the message says which pictures to take."""


@contextmanager
def said_of(what: str, kind: type[RcdnError]) -> Iterator[None]:
    """An error of this kind that is raised inside gets a message that begins with `what` it is about."""
    try:
        yield
    except kind as error:
        raise kind(f"{what}: {error}") from error


def present(value: T | None, what: str) -> T:
    """`value`, if it is not None. Raises RcdnError, naming `what`, if it is None: unlike an assertion, `python -O`
    keeps this check."""
    if value is None:
        raise RcdnError(f"{what} is missing")
    return value

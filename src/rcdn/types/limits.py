"""Limits that keep the time for a picture proportional to its size, and the warnings when they drop something."""

from __future__ import annotations

READ_IN_A_MIRROR = "mirrored: "
"""beginning of the warning that codes were readable only in the mirrored picture"""


def allowed(pixels: int, least: int, each: int) -> int:
    """The limit for a picture of `pixels` pixels: `each` per megapixel, but at least `least`."""
    return max(least, each * pixels // 1_000_000)


class Warnings:
    """Warnings about data dropped from one picture; of each kind only the first is kept, whichever view adds it."""

    def __init__(self) -> None:
        self._by_kind: dict[str, str] = {}

    def add(self, kind: str, text: str) -> None:
        """Add the warning `text`, unless there is already one of the same `kind`."""
        self._by_kind.setdefault(kind, text)

    @property
    def texts(self) -> tuple[str, ...]:
        """The warnings, one line each."""
        return tuple(self._by_kind.values())

"""Limits that keep the time for a picture in proportion to its size, and the warnings where they leave something out."""

from __future__ import annotations

READ_IN_A_MIRROR = "mirrored: "
"""how the warning of codes begins that can be read in a mirror only"""


def allowed(pixels: int, least: int, each: int) -> int:
    """`each` a megapixel, but at least `least`."""
    return max(least, each * pixels // 1_000_000)


class Warnings:
    """What was left out of one picture, each kind told once: by the first view that met it."""

    def __init__(self) -> None:
        self._told: dict[str, str] = {}

    def add(self, kind: str, text: str) -> None:
        """Tell `text`, unless something of that kind was told."""
        self._told.setdefault(kind, text)

    @property
    def texts(self) -> tuple[str, ...]:
        """One line each."""
        return tuple(self._told.values())

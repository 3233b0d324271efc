"""Shapes that a sheet is printed with. x right, y down, in whatever unit the sheet has; later shapes lie over earlier ones."""

from __future__ import annotations

from dataclasses import dataclass

Point = tuple[float, float]


@dataclass(frozen=True)
class Rect:
    """A filled black rectangle; (x, y) is its top-left corner."""

    x: float
    y: float
    width: float
    height: float

    def placed(self, scale: float, left: float, top: float) -> Rect:
        """`scale` times as large, then moved by (left, top)."""
        return Rect(left + self.x * scale, top + self.y * scale, self.width * scale, self.height * scale)


@dataclass(frozen=True)
class Area:
    """What lies within an odd number of closed `loops` of points, filled black."""

    loops: tuple[tuple[Point, ...], ...]

    def placed(self, scale: float, left: float, top: float) -> Area:
        """`scale` times as large, then moved by (left, top)."""
        return Area(tuple(tuple((left + x * scale, top + y * scale) for x, y in loop) for loop in self.loops))


@dataclass(frozen=True)
class Disc:
    """A filled circle around (x, y), black or `white`."""

    x: float
    y: float
    radius: float
    white: bool

    def placed(self, scale: float, left: float, top: float) -> Disc:
        """`scale` times as large, then moved by (left, top)."""
        return Disc(left + self.x * scale, top + self.y * scale, self.radius * scale, self.white)


Shape = Rect | Area | Disc

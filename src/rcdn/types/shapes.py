"""Shapes on a printed sheet. x right, y down, in the sheet's unit; later shapes are drawn over earlier ones."""

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
        """The shape scaled by `scale`, then translated by (left, top)."""
        return Rect(left + self.x * scale, top + self.y * scale, self.width * scale, self.height * scale)


@dataclass(frozen=True)
class Area:
    """The area inside an odd number of the closed `loops` of points, filled black (even–odd rule)."""

    loops: tuple[tuple[Point, ...], ...]

    def placed(self, scale: float, left: float, top: float) -> Area:
        """The shape scaled by `scale`, then translated by (left, top)."""
        return Area(tuple(tuple((left + x * scale, top + y * scale) for x, y in loop) for loop in self.loops))


@dataclass(frozen=True)
class Disc:
    """A filled circle around (x, y), black or `white`."""

    x: float
    y: float
    radius: float
    white: bool

    def placed(self, scale: float, left: float, top: float) -> Disc:
        """The shape scaled by `scale`, then translated by (left, top)."""
        return Disc(left + self.x * scale, top + self.y * scale, self.radius * scale, self.white)


Shape = Rect | Area | Disc

"""Corners of one picture, and the boards that they form."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np

from rcdn.errors import ConfigError, RcdnError, many, shown
from rcdn.types.arrays import Real
from rcdn.types.base import Array, Value, freeze
from rcdn.types.plane import Pattern, Plane
from rcdn.types.ranges import BOX, LABEL, POSITION, two_integers, whole_size
from rcdn.types.shown import drawing, paragraph
from rcdn.types.target import AprilGrid, Target

Orientation = Literal["unique", "ambiguous_180", "ambiguous_90", "ambiguous_120"]


class Status(IntEnum):
    """Status of a corner's position."""

    REFINED = 0
    """The refinement converged; xy is sub-pixel."""
    SEED = 1
    """The refinement failed; xy is its initial guess, unchanged."""
    LOW_CONFIDENCE = 2
    """Refined, but the response was below the usual threshold."""
    COMPLETED = 3
    """Refined, and detected at a position that its board predicted."""


LAST = int(max(Status))
"""largest value of `Status`"""


def _freeze_status(owner: Any) -> None:
    freeze(owner, "status", owner.status, np.uint8, ())
    if len(owner.status) and owner.status.max() > LAST:
        raise RcdnError(f"{type(owner).__name__}.status must hold values of Status, 0 to {LAST}")


def _freeze_sigma(owner: Any) -> None:
    if owner.sigma is None:
        return
    freeze(owner, "sigma", owner.sigma, np.float64, ())
    if (owner.sigma < 0).any():
        raise RcdnError(f"{type(owner).__name__}.sigma must not be negative; NaN where it is unknown")


@dataclass(frozen=True, eq=False)
class Corners(Value):
    """X-corners of one image, sorted by response (falling), then x, then y.

    `xy` (N, 2) px; `response` (N,); `axes` (N, 2) the two edge directions, radians in [0, π), or None;
    `status` (N,) values of `Status`; `sigma` (N,) standard deviation, px, or None if not estimated.
    """

    xy: Array
    response: Array
    status: Array
    axes: Array | None = None
    sigma: Array | None = None

    def __post_init__(self) -> None:
        freeze(self, "xy", self.xy, np.float64, (2,), POSITION)
        freeze(self, "response", self.response, np.float64, ())
        _freeze_status(self)
        if self.axes is not None:
            freeze(self, "axes", self.axes, np.float64, (2,))
        _freeze_sigma(self)
        for name in ("response", "status", "axes", "sigma"):
            value = getattr(self, name)
            if value is not None and len(value) != len(self.xy):
                raise RcdnError(f"Corners.{name} has {len(value)} rows, but xy has {len(self.xy)}")

    def __len__(self) -> int:
        return len(self.xy)

    def __repr__(self) -> str:
        counts = np.bincount(self.status, minlength=len(Status)).tolist()
        kinds = [f"{counts[s]} {s.name.lower().replace('_', ' ')}" for s in Status if counts[s]]
        return f"<Corners: {len(self)}{' – ' * bool(kinds)}{', '.join(kinds)}>"

    def take(self, index: Any) -> Corners:
        """The corners at `index` (integers or a boolean mask), in that order."""
        pick = lambda a: None if a is None else a[index]  # noqa: E731
        if not isinstance(index, np.ndarray) or index.ndim != 1:
            return Corners(self.xy[index], self.response[index], self.status[index], pick(self.axes), pick(self.sigma))
        out = object.__new__(Corners)  # rows of what was checked need no checks
        out.__setstate__({name: pick(value) for name, value in vars(self).items()})
        return out

    def sort(self) -> Corners:
        """The same corners by response (falling), then x, then y."""
        return self.take(np.lexsort((self.xy[:, 1], self.xy[:, 0], -self.response)))


@dataclass(frozen=True, eq=False)
class Board(Value):
    """One recovered grid in one image. Labels are relative to the visible part.

    `xy` (M, 2) px, of which calibrations and poses refuse NaN: a corner without a position is to be left out; `ij`
    (M, 2) integer (column, row), row by row, both from 0; the grid is right-handed in the image (columns × rows like
    x × y). `image_size` (width, height) px. `complete`: no label of the bounding grid is missing.
    `orientation`: whether the colours determine which corner is (0, 0); see docs/conventions.md.
    `response` (M,), `status` (M,) as in `Corners`. `pattern`: for a `deltille`, i and j run along two edges of a
    triangle, 60° apart, and the extent of the board is unknown, so that it is never `complete`; for an `aprilgrid` they
    count the tags' corners, two per tag. `target`, `ids` (M,): the coded target that was read, and the corners' numbers
    as counted by that target's own tools; `ij` is then the position on the target. Both are None for a plain board.
    `origin_dark`: whether the square inside (0, 0), the one between (0, 0) and (1, 1), is dark; None if unknown, and
    for other boards than plain ones of squares.
    """

    xy: Array
    ij: Array
    image_size: tuple[int, int]
    response: Array
    status: Array
    orientation: Orientation
    sigma: Array | None = field(default=None)
    pattern: Pattern = "checker"
    target: Target | None = None
    ids: Array | None = None
    origin_dark: bool | None = None

    def __post_init__(self) -> None:
        for name, known in (("orientation", get_args(Orientation)), ("pattern", get_args(Pattern))):
            if getattr(self, name) not in known:
                raise RcdnError(f"Board.{name} must be one of {', '.join(known)}, not {shown(getattr(self, name))}")
        freeze(self, "xy", self.xy, np.float64, (2,), POSITION)
        freeze(self, "ij", self.ij, np.int64, (2,), LABEL)
        freeze(self, "response", self.response, np.float64, ())
        _freeze_status(self)
        _freeze_sigma(self)
        if not isinstance(self.target, Target | None):
            raise RcdnError(
                f"Board.target must be a Charuco, AprilGrid or PuzzleBoard, or None, not {shown(self.target)}"
            )
        if self.ids is not None:
            freeze(self, "ids", self.ids, np.int64, ())
        if not isinstance(self.origin_dark, bool | None):
            raise RcdnError(f"Board.origin_dark must be True, False or None, not {shown(self.origin_dark)}")
        if (self.ids is None) != (self.target is None) or (self.ids is not None and len(self.ids) != len(self.xy)):
            raise RcdnError("Board.ids must have one row a corner, and come with a target")
        if not len(self.xy) == len(self.ij) == len(self.response) == len(self.status):
            raise RcdnError("Board.xy, ij, response and status must have one row a corner each")
        if self.sigma is not None and len(self.sigma) != len(self.xy):
            raise RcdnError(f"Board.sigma has {len(self.sigma)} rows, but xy has {len(self.xy)}")
        if len(np.unique(self.ij @ (1, 1 << 20))) != len(self.ij):
            raise RcdnError("Board.ij must not hold a label twice")
        object.__setattr__(self, "image_size", whole_size(self.image_size, "Board.image_size"))
        if self.size[0] * self.size[1] > BOX:
            raise RcdnError(
                f"Board.ij spans {self.size[0]}×{self.size[1]} labels, more than {BOX}; are they column and row?"
            )

    def __len__(self) -> int:
        return len(self.xy)

    def __repr__(self) -> str:
        kind = self.pattern if self.target is None else str(self.target)
        (cols, rows), (width, height) = self.size, self.image_size
        whole = "complete" if self.complete else "in part"
        return (
            f"<Board {cols}×{rows} {whole}, {many(len(self), 'corner')}, {kind}, {self.orientation}, "
            f"in {width}×{height} px>"
        )

    def _repr_html_(self) -> str:
        return drawing(self.image_size, [(self.xy, self.ij)]) + paragraph(repr(self)[1:-1])

    @cached_property
    def size(self) -> tuple[int, int]:
        """(columns, rows) of the bounding grid, in inner corners."""
        if not len(self.ij):
            return 0, 0
        i, j = self.ij.T
        return int(i.max() - i.min()) + 1, int(j.max() - j.min()) + 1

    @property
    def complete(self) -> bool:
        """True if no label of the bounding grid is missing; False for a deltille."""
        return self.pattern != "deltille" and len(self) == self.size[0] * self.size[1]

    @property
    def plane(self) -> Plane:
        """The printed plane of the labels; without a gap for a board of tags that were not read."""
        return Plane(self.pattern, self.target.gap if isinstance(self.target, AprilGrid) else None)

    @property
    def points(self) -> Real[Array, "m 2"]:
        """(M, 2) positions of the corners on the board, in squares (edges of a deltille's triangles, sides of tags);
        see `plane_points`."""
        return self.plane.points(self.ij)

    def grid(self) -> Array:
        """Positions as a (rows, columns, 2) array, NaN where a corner is missing."""
        cols, rows = self.size
        out = np.full((rows, cols, 2), np.nan)
        i, j = (self.ij - self.ij.min(axis=0)).T if len(self) else (np.zeros(0, int), np.zeros(0, int))
        out[j, i] = self.xy
        return out

    def grid_of(self, size: tuple[int, int]) -> Array | None:
        """`grid()` as a board of `size` (columns, rows), rotated by 90° if needed to fit; None if the board has another
        size.

        It is never mirrored, and a deltille isn't rotated. Of the two rotations by 90°, the one that preserves the
        colour of the square inside (0, 0) is used, so that an unambiguous board remains unambiguous.
        Raises ConfigError for a `size` that isn't two whole numbers.
        """
        wanted = two_integers(size)
        if wanted is None:
            raise ConfigError(f"size must be (columns, rows) of inner corners, whole numbers, not {shown(size)}")
        grid = self.grid()
        if self.size == wanted:
            return grid
        if self.pattern != "checker":
            return None
        if self.size != wanted[::-1]:
            return None
        return np.rot90(grid, 1) if self.size[0] % 2 == 0 else np.rot90(grid, -1)


def usual_size(boards: Iterable[Board]) -> tuple[int, int] | None:
    """The most frequent size of complete boards; a size and its transpose are counted together, and the more frequent
    of the two is returned. Among equally frequent sizes, the largest.

    None if no board is complete.
    """
    sizes = Counter(board.size for board in boards if board.complete)
    if not sizes:
        return None
    either = {s: n + sizes[s[::-1]] * (s[0] != s[1]) for s, n in sizes.items()}
    return max(either, key=lambda s: (either[s], s[0] * s[1], sizes[s], s))

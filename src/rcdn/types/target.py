"""Targets with codes: ChArUco boards, PuzzleBoards and AprilGrids."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from numbers import Integral
from typing import Any, ClassVar

import numpy as np

from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.types.arrays import Real, Shaped
from rcdn.types.base import Array
from rcdn.types.plane import plane_points

LARGEST = 1000
"""largest number of squares or tags along a side"""
LAST = 9999
"""largest first number of a marker or tag; OpenCV's largest dictionary has 2,320"""
PUZZLE = 501
"""columns and rows of the PuzzleBoard's master code"""


@dataclass(frozen=True)
class Charuco:
    """A ChArUco board. `columns` × `rows` squares (rows None: its lower end was not seen); `dictionary`: OpenCV's name;
    `marker`: side of a marker ÷ side of a square; `first_id` of the markers; `legacy`: the square at the top left is
    white (OpenCV before 4.6), False for odd rows, with which both layouts are the same; `inverted`: white markers in
    black squares.

    Corners are numbered as in OpenCV: row by row from the top left, columns − 1 per row. `ij` starts there at (0, 0).
    Raises ConfigError for a field out of range; whether OpenCV has the dictionary is checked where it is used.
    """

    columns: int
    rows: int | None
    dictionary: str
    marker: float
    first_id: int = 0
    legacy: bool = False
    inverted: bool = False
    kind: ClassVar[str] = "charuco"

    def __post_init__(self) -> None:
        _whole(self, "columns", 2)
        _whole(self, "rows", 1)
        _whole(self, "first_id", 0, LAST)
        _share(self, "marker")
        _named(self, "dictionary")
        _truth(self, "legacy")
        _truth(self, "inverted")
        if self.rows is not None and self.rows % 2:
            object.__setattr__(self, "legacy", False)

    def __str__(self) -> str:
        extra = (
            ("legacy",) * self.legacy
            + ("inverted",) * self.inverted
            + (f"from marker {self.first_id}",) * (self.first_id > 0)
        )
        return " ".join((f"ChArUco {self.columns}x{self.rows or '?'} {self.dictionary}", *extra))

    def ids(self, ij: Real[Array, "n 2"]) -> Real[Array, " n"]:
        """The numbers (N,) of the corners at positions `ij` (N, 2)."""
        return (self.columns - 1) * ij[:, 1] + ij[:, 0]

    def ij_of(self, ids: Real[Array, " n"]) -> Real[Array, "n 2"]:
        """The positions (N, 2) of the corners with the numbers `ids` (N,), the inverse of the method `ids`. Raises
        RcdnError for numbers that don't exist on it."""
        wide = self.columns - 1
        ids = numbers(ids, None if self.rows is None else wide * (self.rows - 1), self)
        return np.stack([ids % wide, ids // wide], axis=1)

    def places(self) -> Real[Array, "n 2"]:
        """The positions (N, 2) of all its corners, in ascending order of their numbers. Raises RcdnError if `rows` is
        None."""
        return grid_of(self.columns - 1, _rows_of(self) - 1)

    def plane(self, ij: Real[Array, "... 2"]) -> Array:
        """Points (..., 2) of the corners `ij` (..., 2) on the board, in squares from its first corner."""
        return plane_points(ij)


@dataclass(frozen=True)
class PuzzleBoard:
    """A part of the PuzzleBoard (Stelldinger, Schönherr, Biermann 2024), whose code of 501 × 501 determines the
    position of every corner.

    Corners are numbered 501 · row + column of that code, as by its authors; their `ij` is (column, row), and may exceed
    500, where the code repeats.
    """

    kind: ClassVar[str] = "puzzleboard"

    def __str__(self) -> str:
        return "PuzzleBoard"

    def ids(self, ij: Real[Array, "n 2"]) -> Real[Array, " n"]:
        """The numbers (N,) of the corners at positions `ij` (N, 2)."""
        return PUZZLE * (ij[:, 1] % PUZZLE) + ij[:, 0] % PUZZLE

    def ij_of(self, ids: Real[Array, " n"]) -> Real[Array, "n 2"]:
        """The positions (N, 2), both coordinates below 501, of the corners with the numbers `ids` (N,). Raises
        RcdnError for numbers that don't exist on it."""
        ids = numbers(ids, PUZZLE**2, self)
        return np.stack([ids % PUZZLE, ids // PUZZLE], axis=1)

    def places(self) -> Real[Array, "n 2"]:
        """The positions (N, 2) of all its corners, in ascending order of their numbers."""
        return grid_of(PUZZLE, PUZZLE)

    def plane(self, ij: Real[Array, "... 2"]) -> Array:
        """Points (..., 2) of the corners `ij` (..., 2) on the board, in squares from the first corner of the code."""
        return plane_points(ij)


@dataclass(frozen=True)
class AprilGrid:
    """Kalibr's AprilGrid. `columns` × `rows` tags (rows None: its upper end was not seen); `family`: AprilTag's name;
    `gap`: distance between tags ÷ their side; `border`: width of a tag's black border, bits; `first_id`: the tag at the
    bottom left.

    Corners are numbered as in Kalibr: row by row upwards from the bottom left, 2 · columns per row. A corner's `ij`
    counts from the bottom right, i to the left and j upwards, so that it is right-handed like all labels; the corner
    lies at `plane(ij)`. Raises ConfigError for a field out of range.
    """

    columns: int
    rows: int | None
    family: str
    gap: float
    border: int = 2
    first_id: int = 0
    kind: ClassVar[str] = "aprilgrid"

    def __post_init__(self) -> None:
        _whole(self, "columns", 1)
        _whole(self, "rows", 1)
        _whole(self, "border", 1)
        _whole(self, "first_id", 0, LAST)
        _share(self, "gap")
        _named(self, "family")

    def __str__(self) -> str:
        extra = f" from tag {self.first_id}" if self.first_id else ""
        return f"AprilGrid {self.columns}x{self.rows or '?'} {self.family}{extra}"

    def ids(self, ij: Real[Array, "n 2"]) -> Real[Array, " n"]:
        """The numbers (N,) of the corners at positions `ij` (N, 2)."""
        return 2 * self.columns * ij[:, 1] + 2 * self.columns - 1 - ij[:, 0]

    def ij_of(self, ids: Real[Array, " n"]) -> Real[Array, "n 2"]:
        """The positions (N, 2) of the corners with the numbers `ids` (N,), the inverse of the method `ids`. Raises
        RcdnError for numbers that don't exist on it."""
        wide = 2 * self.columns
        ids = numbers(ids, None if self.rows is None else 2 * wide * self.rows, self)
        return np.stack([wide - 1 - ids % wide, ids // wide], axis=1)

    def places(self) -> Real[Array, "n 2"]:
        """The positions (N, 2) of all its corners, in ascending order of their numbers. Raises RcdnError if `rows` is
        None."""
        return self.ij_of(np.arange(4 * self.columns * _rows_of(self)))

    def plane(self, ij: Real[Array, "... 2"]) -> Array:
        """Points (..., 2) of the corners `ij` (..., 2) on the board, in sides of a tag."""
        return plane_points(ij, "aprilgrid", self.gap)


Target = Charuco | PuzzleBoard | AprilGrid


def _whole(owner: Charuco | AprilGrid, name: str, least: int, most: int = LARGEST) -> None:
    """Keep the field as an int; `rows` may be None. Raises ConfigError for anything but a whole number in the range."""
    value = getattr(owner, name)
    if name == "rows" and value is None:
        return
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, Integral) or not least <= int(value) <= most:
        raise ConfigError(
            f"{type(owner).__name__}.{name} must be a whole number from {least} to {most}, not {shown(value)}"
        )
    object.__setattr__(owner, name, int(value))


def _share(owner: Charuco | AprilGrid, name: str) -> None:
    """Keep the field as a float. Raises ConfigError for anything but a number between 0 and 1."""
    value = getattr(owner, name)
    if not isinstance(value, (int, float, np.integer, np.floating)) or not 0 < value < 1:
        raise ConfigError(f"{type(owner).__name__}.{name} must lie between 0 and 1, not {shown(value)}")
    object.__setattr__(owner, name, float(value))


def _named(owner: Charuco | AprilGrid, name: str) -> None:
    """Raise ConfigError unless the field is a text."""
    if not isinstance(getattr(owner, name), str):
        raise ConfigError(f"{type(owner).__name__}.{name} must be a name, not {shown(getattr(owner, name))}")


def _truth(owner: Charuco | AprilGrid, name: str) -> None:
    """Keep the field as a bool. Raises ConfigError for anything but True and False."""
    value = getattr(owner, name)
    if not isinstance(value, (bool, np.bool_)):
        raise ConfigError(f"{type(owner).__name__}.{name} must be True or False, not {shown(value)}")
    object.__setattr__(owner, name, bool(value))


def grid_of(columns: int, rows: int) -> Array:
    """The labels (columns · rows, 2) of a whole grid, row by row."""
    return np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)


def numbers(ids: Shaped[Array, " n"], count: int | None, target: object) -> Array:
    """`ids` (N,) as int64. Raises RcdnError for a number outside of 0 to `count` − 1 (None: no upper limit), the range
    of the corners of `target`."""
    ids = np.asarray(ids)
    if ids.ndim != 1 or (ids.size and ids.dtype.kind not in "iu"):
        raise RcdnError(f"ids must be whole numbers, (N,), not an array {ids.shape} of {ids.dtype}")
    wrong = (ids < 0) | (ids >= (np.inf if count is None else count))
    if wrong.any():
        known = "0 and more" if count is None else f"0 to {count - 1}"
        raise RcdnError(f"ids holds {ids[wrong][0]}, but the corners of a {target} are numbered {known}")
    return ids.astype(np.int64)


def _rows_of(target: Charuco | AprilGrid) -> int:
    if target.rows is None:
        raise RcdnError(f"how many rows a {target} has is not known: not all of it was seen; give its rows")
    return target.rows


_KINDS: dict[str, type[Target]] = {t.kind: t for t in (Charuco, PuzzleBoard, AprilGrid)}


def target_record(target: Target) -> dict[str, Any]:
    """The target as plain values: its kind, and its fields."""
    return {"kind": target.kind} | asdict(target)


def target_of(record: Any) -> Target:
    """The target of a `target_record`. Raises RcdnError if the record is invalid."""
    kind = _KINDS.get(str(record.get("kind"))) if isinstance(record, dict) else None
    if kind is None:
        raise RcdnError(f"a target has a kind, one of {', '.join(_KINDS)}, not {shown(record)}")
    names = {f.name for f in fields(kind)}
    try:
        return kind(**{name: value for name, value in record.items() if name in names})
    except TypeError as error:
        raise RcdnError(f"a target of kind {kind.kind} needs the fields {', '.join(sorted(names))}") from error

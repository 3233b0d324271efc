"""What is printed on boards that carry codes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any, ClassVar

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types.base import Array

PUZZLE = 501
"""columns and rows of the PuzzleBoard's master code"""


@dataclass(frozen=True)
class Charuco:
    """A ChArUco board. `columns` × `rows` squares (rows None: its foot was not seen); `dictionary` as OpenCV calls it; `marker`: side of a marker
    over side of a square; `first_id` of the markers; `legacy`: rows are even and the square at the top left is white (OpenCV before 4.6);
    `inverted`: white markers in black squares.

    Corners are numbered as OpenCV numbers them: row by row from the top left, columns − 1 a row. A corner's `ij` begins at (0, 0) there.
    """

    columns: int
    rows: int | None
    dictionary: str
    marker: float
    first_id: int = 0
    legacy: bool = False
    inverted: bool = False
    kind: ClassVar[str] = "charuco"

    def ids(self, ij: Array) -> Array:
        """The numbers (N,) of the corners at places `ij` (N, 2)."""
        return (self.columns - 1) * ij[:, 1] + ij[:, 0]


@dataclass(frozen=True)
class PuzzleBoard:
    """A part of the PuzzleBoard (Stelldinger, Schönherr, Biermann 2024), whose code of 501 × 501 has a place for every corner.

    Corners are numbered 501 · row + column of that code, as its authors do; their `ij` is (column, row), and may go on beyond 500, where the code
    begins again.
    """

    kind: ClassVar[str] = "puzzleboard"

    def ids(self, ij: Array) -> Array:
        """The numbers (N,) of the corners at places `ij` (N, 2)."""
        return PUZZLE * (ij[:, 1] % PUZZLE) + ij[:, 0] % PUZZLE


@dataclass(frozen=True)
class AprilGrid:
    """Kalibr's AprilGrid. `columns` × `rows` tags (rows None: its top was not seen); `family` as AprilTag calls it; `gap`: distance of tags over their
    side; `border`: width of a tag's black border, bits; `first_id`: the tag at the bottom left.

    Corners are numbered as Kalibr numbers them: row by row upwards from the bottom left, 2 · columns a row. A corner's `ij` counts from the bottom
    right, i to the left and j upwards, so that it is right-handed like every label; it lies at `plane(ij)`.
    """

    columns: int
    rows: int | None
    family: str
    gap: float
    border: int = 2
    first_id: int = 0
    kind: ClassVar[str] = "aprilgrid"

    def ids(self, ij: Array) -> Array:
        """The numbers (N,) of the corners at places `ij` (N, 2)."""
        return 2 * self.columns * ij[:, 1] + 2 * self.columns - 1 - ij[:, 0]

    def plane(self, ij: Array) -> Array:
        """Where the corners `ij` (..., 2) lie on the board, (..., 2), in sides of a tag."""
        ij = np.asarray(ij)
        return np.asarray(ij // 2 * (1 + self.gap) + ij % 2)


Target = Charuco | PuzzleBoard | AprilGrid
_KINDS: dict[str, type[Target]] = {t.kind: t for t in (Charuco, PuzzleBoard, AprilGrid)}


def target_record(target: Target) -> dict[str, Any]:
    """The target as plain values: its kind, and its fields."""
    return {"kind": target.kind} | asdict(target)


def target_of(record: Any) -> Target:
    """The target of a `target_record`. Raises RcdnError if it is none."""
    kind = _KINDS.get(str(record.get("kind"))) if isinstance(record, dict) else None
    if kind is None:
        raise RcdnError(f"a target has a kind, one of {', '.join(_KINDS)}, not {record!r}")
    names = {f.name for f in fields(kind)}
    try:
        target = kind(**{name: value for name, value in record.items() if name in names})
    except TypeError as error:
        raise RcdnError(f"a target of kind {kind.kind} needs the fields {', '.join(sorted(names))}") from error
    if isinstance(target, Charuco):
        _check(target)
    return target


def _check(target: Charuco) -> None:
    whole = {"columns": target.columns, "rows": target.rows, "first_id": target.first_id}
    for name, value in whole.items():
        least = 0 if name == "first_id" else 2
        if name == "rows" and value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= 1000:
            raise RcdnError(f"target.{name} must be a whole number from {least} to 1000, not {value!r}")
    if not isinstance(target.dictionary, str):
        raise RcdnError(f"target.dictionary must be a name such as DICT_4X4_50, not {target.dictionary!r}")
    if isinstance(target.marker, bool) or not isinstance(target.marker, int | float) or not 0 < target.marker < 1:
        raise RcdnError(f"target.marker must lie between 0 and 1, not {target.marker!r}")

"""The printed targets of a set of boards: their identity, the size of their squares or tags, and the position of each
board on its target."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rcdn.calibration.arguments import check_spacing
from rcdn.calibration.labels import Labelled, Size, fits, label_of
from rcdn.calibration.tag_gap import gap_of
from rcdn.errors import CalibrationError, ConfigError, many, shown
from rcdn.geometry.cut import may_be_cut, whole_size
from rcdn.geometry.part import common_colour
from rcdn.geometry.rules import CHECKER
from rcdn.types import SQUARES, AprilGrid, Array, Board, Charuco, Orientation, Plane, PuzzleBoard, Target
from rcdn.types.arrays import Real

Spacing = float | Mapping[str, float]
"""m: the side of a square (of a triangle, of a tag), or a mapping from the name of each kind of board to it"""
KINDS = ("checker", "deltille", Charuco.kind, AprilGrid.kind, PuzzleBoard.kind)
UNREAD = "its codes were not read"


@dataclass(frozen=True, eq=False)
class Geometry:
    """One printed target: its identity by its codes (`target`, None for plain boards), its `plane` with sides of
    `spacing` m, the label `first` that becomes (0, 0), and its `size` (columns, rows) in corners as far as it is
    known; `origin_dark`: whether the square inside (0, 0) of the whole plain board is dark, None if unknown;
    `other_sizes`, the longer side first, of boards that are not parts of this plain one."""

    target: Target | None
    plane: Plane
    spacing: float
    size: Size | None
    first: Array
    origin_dark: bool | None = None
    other_sizes: frozenset[Size] = frozenset()

    @property
    def orientation(self) -> Orientation | None:
        """Whether it is known which corner of a whole board is (0, 0); codes always determine it."""
        if self.target is not None:
            return "unique"
        return None if self.size is None else CHECKER.orientation(*self.size)

    def can_be_of(self, size: Size) -> bool:
        """Whether the whole target can be of this `size`, as far as its codes say."""
        columns, rows = self.size or size
        open_end = not isinstance(self.target, PuzzleBoard | None) and self.target.rows is None
        return size[0] == columns and (size[1] >= rows if open_end else size[1] == rows)


@dataclass(frozen=True, eq=False)
class Geometries:
    """All targets of a set: `main`, the one that most boards show, and the `others` whose codes were read; `plain`:
    boards without codes in the same set, if their spacing is known."""

    main: Geometry
    others: tuple[Geometry, ...] = ()
    plain: tuple[Geometry, ...] = ()

    @classmethod
    def of(cls, boards: Sequence[Board], spacing: Spacing, size: Size | None = None) -> Geometries:
        """The targets of `boards`. `size`: that of the whole plain board, or None for the most frequent size of those
        that cannot be cut.

        Raises ConfigError if `spacing` is ambiguous for the kinds of the boards or names none of them, or if `size`
        contradicts the codes.
        """
        kinds = Counter(kind_of(b) for b in boards)
        sides = _sides(spacing, kinds)
        coded = _coded([b for b in boards if b.target is not None], sides)
        plain = [b for b in boards if b.target is None and b.pattern in sides and b.pattern != "aprilgrid"]
        if not coded:
            first, *rest = _plain(plain, sides, size)
            return cls(first, (), tuple(rest))
        if size is not None:
            coded[0] = _of_size(coded[0], size)
        if isinstance(spacing, Mapping) and plain:
            return cls(coded[0], tuple(coded[1:]), tuple(_plain(plain, sides, None)))
        found = cls(coded[0], tuple(coded[1:]))
        found._check_majority(boards)
        return found

    def labelled(self, boards: Sequence[Board], strict: bool) -> list[Labelled]:
        """The labels of each board on its target, in the order of `boards`; `strict`: plain boards that cannot be part
        of the whole board are refused."""
        return [self._labelled(board, strict) for board in boards]

    def _labelled(self, board: Board, strict: bool) -> Labelled:
        if board.target is None:
            return self._unread(board) if board.pattern == "aprilgrid" else self._uncoded(board, strict)
        mine = identity(board.target)
        for each in (self.main, *self.others):
            if each.target is not None and identity(each.target) == mine:
                return Labelled(
                    board.ij - each.first, True, "", each.plane, each.spacing, each.target, each is self.main
                )
        return Labelled(board.ij, False, f"it shows another target: {board.target}")

    def _uncoded(self, board: Board, strict: bool) -> Labelled:
        for each in (self.main, *self.plain):
            if each.target is None and each.plane == board.plane:
                colour = None if max(board.size, board.size[::-1]) in each.other_sizes else each.origin_dark
                label = label_of(board, each.size, strict and each is self.main, colour)
                return replace(label, plane=each.plane, spacing=each.spacing, main=each is self.main)
        return self._unread(board)

    def _check_majority(self, boards: Sequence[Board]) -> None:
        """Raise ConfigError if most boards would be left out because their spacing is unknown."""
        left_out = sum(b.target is None and bool(self._unread(b).reason) for b in boards)
        coded = sum(b.target is not None for b in boards)
        if left_out > coded:
            raise ConfigError(
                f"{many(coded, 'board is', 'boards are')} {self.main.target} and "
                f"{many(left_out, 'other has', 'others have')} no codes that could be read: name the spacing of each "
                f"kind (checker=25mm,{kind_name(self.main)}=30mm; in Python a dict of metres), or calibrate from one "
                "kind"
            )

    def _unread(self, board: Board) -> Labelled:
        """Labels of a board without readable codes: a part of the only target at an unknown position, or not usable."""
        own = board.ij - board.ij.min(axis=0) if len(board) else board.ij
        whole = self.main.size
        if self.others or board.plane != self.main.plane or whole is None:
            return Labelled(
                own, False, f"{UNREAD}, or it has none: nobody knows how large it is (name its spacing, too)"
            )
        if not fits(board.size, whole):
            there = "{}×{}".format(*board.size)
            return Labelled(own, False, f"{UNREAD}, and its {there} corners can't be part of the {self.main.target}")
        return Labelled(own, False, "", self.main.plane, self.main.spacing)


def identity(target: Target) -> Target:
    """The part of a target that is the same in all of its views: without measured proportions, and without the number
    of rows seen."""
    if isinstance(target, Charuco):
        return replace(target, rows=None, marker=0.5)
    return replace(target, rows=None, gap=0.5) if isinstance(target, AprilGrid) else target


def kind_of(board: Board) -> str:
    """The board's key in a `Spacing`: the kind of its target, or the pattern of a plain board."""
    return board.pattern if board.target is None else board.target.kind


def same_boards(left: Sequence[Board], right: Sequence[Board]) -> list[tuple[int, int]]:
    """(index in `left`, index in `right`) of the boards that both of two pictures of one moment show; the largest board
    of each is the first.

    Boards with codes are matched by identity if each picture shows that target exactly once; the largest boards of both
    pictures are matched if neither has codes.
    """
    one, two = ([None if b.target is None else identity(b.target) for b in side] for side in (left, right))
    pairs = [(k, two.index(t)) for k, t in enumerate(one) if t is not None and one.count(t) == two.count(t) == 1]
    if left and right and one[0] is None and two[0] is None:
        pairs.append((0, 0))
    return pairs


def kind_name(found: Geometry) -> str:
    """The target's key in a `Spacing`."""
    return found.plane.pattern if found.target is None else found.target.kind


def frame_of(target: Target, spacing: float) -> Real[Array, "4 4"]:
    """T_board_target (4, 4): takes the coordinates of the target's own tools to those of its labels, m.

    The origin of OpenCV's ChArUco boards is the outer corner at the top left, one square before the first inner one.
    That of Kalibr's AprilGrids is the first corner of the first tag, at the bottom left, with x to the right, y up, and
    z towards the viewer; our labels begin at the bottom right. The origin of a PuzzleBoard is that of its code, as for
    our labels.
    """
    T = np.eye(4)
    if isinstance(target, Charuco):
        T[:2, 3] = -spacing
    elif isinstance(target, AprilGrid):
        T[:3, :3] = np.diag([-1.0, 1.0, -1.0])
        T[0, 3] = spacing * target.plane(np.array([2 * target.columns - 1, 0]))[0]
    return T


def _sides(spacing: Any, kinds: Counter[str]) -> dict[str, float]:
    """Side of each kind, m; boards of kinds that are missing cannot be used."""
    if isinstance(spacing, Mapping):
        if unknown := [k for k in spacing if k not in KINDS]:
            raise ConfigError(f"spacing names {', '.join(map(shown, unknown))}; kinds of boards are {', '.join(KINDS)}")
        for value in spacing.values():
            check_spacing(value)
        if not kinds.keys() & spacing.keys():
            raise ConfigError(f"spacing must name the kinds of the boards, {', '.join(sorted(kinds))}")
        return {k: float(v) for k, v in spacing.items()}
    check_spacing(spacing)
    coded = [k for k in KINDS if kinds[k] and k not in ("checker", "deltille")]
    if len(coded) > 1:
        example = ", ".join(f"{k}=30mm" for k in coded)
        raise ConfigError(
            f"the boards are of {len(coded)} kinds ({', '.join(coded)}), and one spacing can't say how large each is: "
            f"name each one's (--spacing {example}; in Python a dict of metres)"
        )
    if not coded and kinds["checker"] and kinds["deltille"]:
        raise ConfigError(
            "boards: some are of squares and some of triangles (deltilles); calibrate from one kind, "
            "or name each one's spacing"
        )
    return dict.fromkeys(coded or KINDS, float(spacing))


def _coded(boards: Sequence[Board], sides: dict[str, float]) -> list[Geometry]:
    """The targets that were read and whose side is known, the one that most boards show first."""
    mine: dict[Target, list[Board]] = {}
    for board in boards:
        if board.target is not None and board.target.kind in sides:
            mine.setdefault(identity(board.target), []).append(board)
    order = sorted(mine, key=lambda t: (-len(mine[t]), -sum(map(len, mine[t]))))
    return [_geometry(mine[t], sides[t.kind]) for t in order]


def _geometry(boards: list[Board], side: float) -> Geometry:
    """The target that all `boards` show."""
    targets = [b.target for b in boards]
    low, high = np.min([b.ij.min(axis=0) for b in boards], axis=0), np.max([b.ij.max(axis=0) for b in boards], axis=0)
    rows = max((t.rows for t in targets if not isinstance(t, PuzzleBoard | None) and t.rows), default=None)
    first = targets[0]
    if isinstance(first, Charuco):
        marker = float(np.median([t.marker for t in targets if isinstance(t, Charuco)]))
        first = replace(first, rows=rows, marker=marker)
        return Geometry(
            first, SQUARES, side, (first.columns - 1, rows - 1 if rows else int(high[1]) + 1), np.zeros(2, int)
        )
    if isinstance(first, AprilGrid):
        gap = gap_of(boards)
        first = replace(first, rows=rows, gap=gap)
        whole = (2 * first.columns, 2 * rows if rows else int(high[1]) + 1)
        return Geometry(first, Plane("aprilgrid", gap), side, whole, np.zeros(2, int))
    return Geometry(first, SQUARES, side, (int(high[0] - low[0]) + 1, int(high[1] - low[1]) + 1), low)


def _plain(boards: Sequence[Board], sides: dict[str, float], size: Size | None) -> list[Geometry]:
    """Plain boards of squares and of triangles, the more frequent kind first."""
    patterns = [p for p, _ in Counter(b.pattern for b in boards).most_common() if p in sides]
    if not patterns:
        raise CalibrationError("no boards whose spacing is known: nothing to calibrate from")
    found = []
    for k, pattern in enumerate(patterns):
        mine = [b for b in boards if b.pattern == pattern]
        whole = (size if k == 0 else None) or whole_size(mine)
        found.append(
            Geometry(
                None, Plane(pattern), sides[pattern], whole, np.zeros(2, int),
                common_colour(mine, whole), _other_sizes(mine, whole),
            )
        )  # fmt: skip
    return found


def _other_sizes(boards: Sequence[Board], whole: Size | None) -> frozenset[Size]:
    """Sizes, the longer side first, other than `whole`, of complete boards that the picture's border cannot have cut: a
    board of such a size may be another one, or one behind a cover, wherever it is."""
    same = set() if whole is None else {whole, whole[::-1]}
    rest = [b for b in boards if b.pattern == "checker" and b.complete and b.size not in same]
    return frozenset(max(b.size, b.size[::-1]) for b in rest if not may_be_cut(b))


def _of_size(found: Geometry, size: Size) -> Geometry:
    """The target, with the number of rows that its codes leave open. Raises ConfigError if `size` contradicts the
    codes."""
    if not found.can_be_of(size):
        columns, rows = found.size or size
        raise ConfigError(
            f"size: the boards' codes say {columns}×{rows} corners ({found.target}), not {size[0]}×{size[1]}; "
            "leave it out"
        )
    return replace(found, size=size)

"""The summary that `rcdn detect` prints: a line for each picture, a table of counts, and a hint about the board's
size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rcdn.batch.work import Failure
from rcdn.errors import many
from rcdn.terminal.group import one_line

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Board

Size = tuple[int, int]
LIST_UP_TO = 20
"""Up to this number of pictures the summary has a line for each; for more pictures, only for those not complete."""


@dataclass(frozen=True)
class BriefBoard:
    """The data of a board for the summary: its `size` (columns, rows) and number of `corners`, as in
    `rcdn.types.Board`."""

    size: Size
    complete: bool
    corners: int
    pattern: str
    target: str = ""


@dataclass(frozen=True)
class Brief:
    """The data of one picture for the summary and the outputs: kept small, so that results use little memory and are
    quickly transferred from a worker.

    `line`: the picture's line in the file of detections; "" if it isn't needed.
    """

    path: str
    corners: int
    boards: tuple[BriefBoard, ...]
    line: str
    warnings: tuple[str, ...] = ()


def brief(result: ImageResult, lines: bool = False) -> Brief:
    """The `Brief` of a `result`; `lines`: with its line for the file of detections."""
    from rcdn.io import image_line

    boards = tuple(map(brief_board, result.boards))
    return Brief(result.path, len(result.corners), boards, image_line(result) if lines else "", result.warnings)


def brief_board(board: Board) -> BriefBoard:
    """The `BriefBoard` of a `board`."""
    return BriefBoard(board.size, board.complete, len(board), board.pattern, str(board.target or ""))


def size_text(size: Size) -> str:
    """The size as text, such as `9×6`."""
    return f"{size[0]}×{size[1]}"


def same(a: Size, b: Size) -> bool:
    """True if the sizes are equal, possibly with columns and rows exchanged."""
    return sorted(a) == sorted(b)


def found(board: BriefBoard, wanted: Size | None) -> bool:
    """True if the board is complete and, if a size is `wanted`, has that size."""
    return board.complete and (wanted is None or same(board.size, wanted))


def status(image: Brief, wanted: Size | None) -> str:
    """`complete`, `partial` or `none`, for the best board of this picture."""
    if any(found(b, wanted) for b in image.boards):
        return "complete"
    return "partial" if image.boards else "none"


def board_text(board: BriefBoard, wanted: Size | None) -> str:
    """A board as text: `9×6`, `8×6 partial (41 of 48)` or `deltille (98 corners)`; a board that can't be part of the
    `wanted` one is described as not of that size."""
    if board.target:
        return f"{board.target} ({many(board.corners, 'corner')})"
    if board.pattern != "checker":
        return f"{board.pattern} ({many(board.corners, 'corner')})"
    size = size_text(board.size)
    if found(board, wanted):
        return size
    whole = wanted if wanted is not None else board.size
    fits = all(a <= b for a, b in zip(sorted(board.size), sorted(whole), strict=True))
    if not fits:
        return f"{size} partial (not {size_text(whole)})"
    return f"{size} partial ({board.corners} of {whole[0] * whole[1]})"


def line(outcome: Brief | Failure, wanted: Size | None) -> tuple[str, str]:
    """(name, description of the detections) for the list of pictures."""
    if isinstance(outcome, Failure):
        message = outcome.message.removeprefix(f"{outcome.name}: ")
        return one_line(outcome.name), f"failed: {one_line(message)}"
    if outcome.boards:
        boards = ", ".join(board_text(b, wanted) for b in outcome.boards)
        return one_line(outcome.path), boards
    return one_line(outcome.path), f"no board ({many(outcome.corners, 'corner')})"


def columns(rows: Sequence[tuple[str, str]]) -> list[str]:
    """(name, text) of each picture as a line, in columns."""
    width = max((len(name) for name, _ in rows), default=0)
    return [f"{name:<{width}}  {text}" for name, text in rows]


class Tally:
    """Counts the outcomes, picture by picture. `wanted`: the only board size that counts as complete; None: any.
    `targets`: how many boards have each target, as text, "" for those without codes."""

    def __init__(self, wanted: Size | None) -> None:
        self.images = 0
        self.targets: Counter[str] = Counter()
        self.failures: list[Failure] = []
        self._wanted = wanted
        self._complete_rows: list[tuple[int, tuple[str, str]]] = []
        self._other_rows: list[tuple[int, tuple[str, str]]] = []
        self._outcomes = 0
        self._counts: Counter[str] = Counter()
        self._failed_only: set[str] = set()
        self._last = ""
        self._sizes: set[Size] = set()
        self._with_complete = 0

    def add(self, outcome: Brief | Failure) -> None:
        """Count one outcome; a picture with two of them (its drawing failed) is one picture."""
        self._list(outcome)
        if isinstance(outcome, Failure):
            self.failures.append(outcome)
            if outcome.name != self._last:
                self._failed_only.add(outcome.name)
            return
        self.images += 1
        self._last = outcome.path
        self._counts[status(outcome, self._wanted)] += 1
        self._counts["boards"] += len(outcome.boards)
        self._counts["corners"] += outcome.corners
        self.targets.update(b.target for b in outcome.boards)
        complete = {_wide(b.size) for b in outcome.boards if b.complete}
        self._sizes |= complete
        self._with_complete += bool(complete)

    @property
    def no_board(self) -> bool:
        """Whether pictures were read, and no board was found in any."""
        return self.images > 0 and self._counts["boards"] == 0

    def lines(self, seconds: float) -> list[str]:
        """A line for each picture if there are few, else for each that isn't complete; then the table, and a hint if
        any."""
        hint = size_hint(self._wanted, self._sizes, self._with_complete, self.images)
        rows = self._other_rows
        if self._outcomes <= LIST_UP_TO:
            rows = sorted(self._complete_rows + rows)
        listed = [*columns([row for _, row in rows]), ""] if rows else []
        return [*listed, *self._table(seconds), *([f"hint: {hint}"] if hint else [])]

    def _list(self, outcome: Brief | Failure) -> None:
        """Store the line of an outcome that may be listed at the end."""
        whole = isinstance(outcome, Brief) and status(outcome, self._wanted) == "complete"
        rows = self._complete_rows if whole else self._other_rows
        if not whole or self._outcomes < LIST_UP_TO:
            rows.append((self._outcomes, line(outcome, self._wanted)))
        self._outcomes += 1

    def _table(self, seconds: float) -> list[str]:
        """Two lines: names and numbers. `complete`, `partial`, `none` and `failed` count pictures by their best
        board."""
        counts = self._counts
        cells = {
            "pictures": str(self.images + len(self._failed_only)),
            **{name: str(counts[name]) for name in ("complete", "partial", "none")},
            "failed": str(len(self.failures)),
            **{name: str(counts[name]) for name in ("boards", "corners")},
            "seconds": f"{seconds:.1f}",
        }
        widths = [max(len(k), len(v)) for k, v in cells.items()]
        return ["  ".join(f"{c:>{w}}" for c, w in zip(row, widths, strict=True)) for row in (cells, cells.values())]


def size_hint_of(images: Sequence[ImageResult], wanted: Size | None) -> str | None:
    """`size_hint` for the complete boards of pictures."""
    complete = [{_wide(board.size) for board in image.boards if board.complete} for image in images]
    return size_hint(wanted, set().union(*complete), sum(map(bool, complete)), len(images))


def size_hint(wanted: Size | None, sizes: Set[Size], pictures: int, of: int) -> str | None:
    """A hint at the board size that the user probably meant, or None.

    Given if all complete boards have one size (`sizes`) that differs from the `wanted` one; they were found in
    `pictures` out of `of` pictures. Most often squares were counted instead of inner corners.
    """
    if wanted is None or len(sizes) != 1 or _wide(wanted) in {_wide(s) for s in sizes}:
        return None
    cols, rows = size = _wide(next(iter(sizes)))
    if wanted[0] < wanted[1]:
        cols, rows = size = rows, cols
    question = f"did you mean --board {cols}x{rows}?"
    seen = f"found {size_text(size)} in {pictures} of {many(of, 'picture')}"
    if same((cols + 1, rows + 1), wanted):
        return f"{seen}: {wanted[0]}x{wanted[1]} squares have {size_text(size)} inner corners; {question}"
    return f"{seen}, and {size_text(wanted)} in none; {question}"


def _wide(size: Size) -> Size:
    return max(size), min(size)

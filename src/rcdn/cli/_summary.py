"""What `rcdn detect` says at the end: a line a picture, a table of counts, and a hint about the board's size."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING

from rcdn.cli._batch import Failure
from rcdn.cli._group import one_line

if TYPE_CHECKING:
    from rcdn.io import ImageResult
    from rcdn.types import Board

Size = tuple[int, int]


def size_text(size: Size) -> str:
    """`9×6`."""
    return f"{size[0]}×{size[1]}"


def same(a: Size, b: Size) -> bool:
    """True if the sizes agree, upright or turned by a quarter."""
    return sorted(a) == sorted(b)


def found(board: Board, wanted: Size | None) -> bool:
    """True if the board is complete and, if a size is `wanted`, has that size."""
    return board.complete and (wanted is None or same(board.size, wanted))


def status(image: ImageResult, wanted: Size | None) -> str:
    """`complete`, `partial` or `none`: the best that this picture has."""
    if any(found(b, wanted) for b in image.boards):
        return "complete"
    return "partial" if image.boards else "none"


def board_text(board: Board, wanted: Size | None) -> str:
    """`9×6`, or `8×6 partial (41 of 48)`, or `deltille (98 corners)`; of a board that can't be part of the `wanted` one, what it is instead."""
    if board.pattern != "checker":
        return f"{board.pattern} ({len(board)} corners)"
    size = size_text(board.size)
    if found(board, wanted):
        return size
    whole = wanted if wanted is not None else board.size
    fits = all(a <= b for a, b in zip(sorted(board.size), sorted(whole), strict=True))
    if not fits:
        return f"{size} partial (not {size_text(whole)})"
    return f"{size} partial ({len(board)} of {whole[0] * whole[1]})"


def line(outcome: ImageResult | Failure, wanted: Size | None) -> tuple[str, str]:
    """(name, what was found in it) for the list of pictures."""
    if isinstance(outcome, Failure):
        message = outcome.message.removeprefix(f"{outcome.name}: ")
        return one_line(outcome.name), f"failed: {one_line(message)}"
    if outcome.boards:
        boards = ", ".join(board_text(b, wanted) for b in outcome.boards)
        return one_line(outcome.path), boards
    return one_line(outcome.path), f"no board ({len(outcome.corners)} corners)"


def picture_lines(outcomes: Sequence[ImageResult | Failure], wanted: Size | None) -> list[str]:
    """One line a picture, in columns."""
    rows = [line(o, wanted) for o in outcomes]
    width = max((len(name) for name, _ in rows), default=0)
    return [f"{name:<{width}}  {text}" for name, text in rows]


def table(outcomes: Sequence[ImageResult | Failure], wanted: Size | None, seconds: float) -> list[str]:
    """Two lines: names and numbers. `complete`, `partial`, `none` and `failed` count pictures by their best board."""
    images = [o for o in outcomes if not isinstance(o, Failure)]
    counts = Counter(status(i, wanted) for i in images)
    cells = {
        "pictures": str(len({o.name if isinstance(o, Failure) else o.path for o in outcomes})),
        "complete": str(counts["complete"]),
        "partial": str(counts["partial"]),
        "none": str(counts["none"]),
        "failed": str(len(outcomes) - len(images)),
        "boards": str(sum(len(i.boards) for i in images)),
        "corners": str(sum(len(i.corners) for i in images)),
        "seconds": f"{seconds:.1f}",
    }
    widths = [max(len(k), len(v)) for k, v in cells.items()]
    return ["  ".join(f"{c:>{w}}" for c, w in zip(row, widths, strict=True)) for row in (cells, cells.values())]


def size_hint(images: Sequence[ImageResult], wanted: Size | None) -> str | None:
    """A guess at what the user meant, if complete boards were found but all of one size that isn't `wanted`.

    Most often squares were counted instead of inner corners.
    """
    if wanted is None:
        return None
    sizes = {_wide(b.size) for i in images for b in i.boards if b.complete}
    if len(sizes) != 1 or _wide(wanted) in sizes:
        return None
    cols, rows = size = sizes.pop()
    if wanted[0] < wanted[1]:
        cols, rows = size = rows, cols
    count = sum(any(b.complete for b in i.boards) for i in images)
    ask = f"did you mean --board {cols}x{rows}?"
    seen = f"found {size_text(size)} in {count} of {len(images)} pictures"
    if same((cols + 1, rows + 1), wanted):
        return f"{seen}: {wanted[0]}x{wanted[1]} squares have {size_text(size)} inner corners; {ask}"
    return f"{seen}, and {size_text(wanted)} in none; {ask}"


def _wide(size: Size) -> Size:
    return max(size), min(size)

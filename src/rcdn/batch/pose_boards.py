"""The boards that `rcdn pose` places: all, or those of the size or the target that was asked for; and which of them are
seen in part."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING

from rcdn.batch.no_board import may_be
from rcdn.batch.summary import board_text, brief_board, same, size_hint_of, size_text
from rcdn.errors import many
from rcdn.terminal import console
from rcdn.terminal.group import one_line
from rcdn.terminal.spacing import Length, Lengths, check_spacing, sizes_of

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered
    from rcdn.io import ImageResult
    from rcdn.types import Board, Target

NAMED = 3
"""largest number of pictures that a message names"""


class PoseBoards:
    """The boards in what was `read`, of which those are placed that have the `size` (columns, rows), whole, if one is
    given, and are of the `target`, if one alone is read: the `length` is that of its squares or tags."""

    def __init__(
        self,
        read: Sequence[Gathered],
        size: tuple[int, int] | None,
        target: str | Target,
        length: Length | Lengths,
    ) -> None:
        self.read = read
        self.images = [image for got in read for image in got.images]
        self._size, self._target, self._length = size, target, length

    def check(self) -> None:
        """Print what is left out, and which poses are those of parts. Raises ConfigError if the length makes a board of
        metres."""
        taken = [board for image in self.images for _, board in self.of(image)]
        check_spacing(self._length, sizes_of(taken, self._size))
        if not taken:
            return  # `nothing` says why
        for names, reason in self._left_out():
            console.note(f"left out: {names}: {reason}")
        if parts := sum(bool(self.part_text(board)) for board in taken):
            whole = "COLSxROWS" if self.whole is None else "{}x{}".format(*self.whole)
            console.note(
                f"hint: {parts} of {many(len(taken), 'board')} {'is' if parts == 1 else 'are'} seen in part: the pose "
                "is that of the part's own corner (0, 0), which may be another one of the board; --board "
                f"{whole} leaves such boards out, and boards with codes (`rcdn board --pattern charuco`) have the pose "
                "of the whole where a part is seen"
            )

    def of(self, image: ImageResult) -> list[tuple[int, Board]]:
        """The boards of a picture that are placed, each with its number in the picture."""
        return [(k, board) for k, board in enumerate(image.boards) if not self._reason(board)]

    def line_end(self, board: Board, several: bool) -> str:
        """The end of a pose's line: that it is a part's, or which one of `several` boards of the picture it is; ""
        otherwise."""
        text = self.part_text(board) or (board_text(brief_board(board), None) if several else "")
        return text and f"  {text}"

    def complete(self, board: Board) -> bool:
        """Whether no corner of the whole board is known to be missing."""
        return board.complete and not self._smaller(board)

    def part_text(self, board: Board) -> str:
        """`part of a board, 9×4 (21 of 36 corners)` for a plain board whose corner (0, 0) may be another one of the
        whole board; "" for others."""
        known = self.whole is not None and same(board.size, self.whole)
        if board.target is not None or board.pattern == "deltille" or known or self.complete(board):
            return ""
        cols, rows = self.whole if self.whole is not None and _fits(board.size, self.whole) else board.size
        return f"part of a board, {size_text(board.size)} ({len(board)} of {cols * rows} corners)"

    @cached_property
    def whole(self) -> tuple[int, int] | None:
        """(columns, rows) of the whole plain boards: as given, or that of most of the plain boards of several pictures;
        None if it isn't known."""
        from rcdn.geometry.cut import whole_size

        if self._size is not None or len(self.images) < 2:
            return self._size
        plain = [b for image in self.images for b in image.boards if b.pattern == "checker" and b.target is None]
        size = whole_size(plain)
        if size is None or 2 * sum(b.complete and same(b.size, size) for b in plain) <= len(plain):
            return None
        return size

    def nothing(self) -> str:
        """Why no board is placed."""
        if not self.images:
            return "there are no pictures in what was given"
        if hint := size_hint_of(self.images, self._size):
            return hint
        found = [(image.path, board) for image in self.images for board in image.boards]
        if not found:
            return "no board was found in the pictures; see what `rcdn detect PICTURES --overlay DIR` draws"
        if self._size is None or not any(self._of_target(board) for _, board in found):
            return f"none of {many(len(found), 'board')} in the pictures is known to be of the target {self._target}"
        some = [f"{self._text(board)} in {one_line(path)}" for path, board in found[:NAMED]]
        return (
            f"no whole {size_text(self._size)} board was found: {', '.join(some)}{', …' if found[NAMED:] else ''}; of "
            "boards of a given size only whole ones have a pose, since of a part it isn't known which it is"
        )

    def _text(self, board: Board) -> str:
        """The board, as a part of one of the given size if it can be."""
        part = self._size is not None and _fits(board.size, self._size)
        return board_text(brief_board(board), self._size if part else None)

    def _left_out(self) -> Iterator[tuple[str, str]]:
        """(names of pictures, reason) of the boards that aren't placed."""
        names: dict[str, list[str]] = {}
        for image in self.images:
            for reason in filter(None, map(self._reason, image.boards)):
                names.setdefault(reason, []).append(one_line(image.path))
        for reason, all_ in names.items():
            once = list(dict.fromkeys(all_))
            yield ", ".join(once[:NAMED]) + (", …" if once[NAMED:] else ""), reason

    def _reason(self, board: Board) -> str:
        """Why a board isn't placed; "" if it is."""
        from rcdn.calibration.coded import UNREAD

        if not self._of_target(board):
            if board.target is None:
                return f"{UNREAD}, or it has none; {self._target} was asked for"
            return f"it shows another target: {board.target}"
        if self._size is not None and not (board.complete and same(board.size, self._size)):
            return f"not a whole {size_text(self._size)} board"
        return ""

    def _of_target(self, board: Board) -> bool:
        """Whether the board is of the target, or has a length of its own."""
        from rcdn.calibration.coded import kind_of

        if isinstance(self._target, str):
            return True
        kind = kind_of(board)
        if isinstance(self._length, Lengths) and kind in self._length and kind != self._target.kind:
            return True
        return board.target is not None and may_be(str(board.target), str(self._target))

    def _smaller(self, board: Board) -> bool:
        whole = self.whole
        plain = board.target is None and board.pattern == "checker"
        return plain and whole is not None and not same(board.size, whole) and _fits(board.size, whole)


def _fits(size: tuple[int, int], whole: tuple[int, int]) -> bool:
    return all(a <= b for a, b in zip(sorted(size), sorted(whole), strict=True))

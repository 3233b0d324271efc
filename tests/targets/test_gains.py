"""The most evidence that a layout can have, against all layouts one by one."""

import numpy as np
import pytest

from rcdn.targets.families import Family, families
from rcdn.targets.gains import MOST_COLUMNS, SLACK, MarkedSquares
from rcdn.targets.layout import index_of

BORDER = 1
CHORDS = 0.5
"""bits a square by which chords lie over the logarithm, at most"""


def squares(rows, columns, seed, side=4, first=True, scale=1.5):
    """Squares of a board with random modules, some of whose corners weren't found."""
    rng = np.random.default_rng(seed)
    marked = (np.add.outer(np.arange(rows), np.arange(columns)) % 2 == 0) == first
    ratios = np.where(marked[..., None, None], rng.normal(0, scale, (rows, columns, side + 2, side + 2)), 0.0)
    return MarkedSquares(np.clip(ratios, -4, 4), marked, rng.random(marked.shape) < 0.8, BORDER)


def small(count, side=4):
    """A family of few markers, so that all layouts can be tried."""
    whole = families(side)[0]
    return Family(whole.bits[:count], whole.names[:1], (count,))


def likeliest(turned, gain):
    """The evidence of the likeliest of all layouts, as `scored` of rcdn.targets.charuco counts it."""
    count, best = gain.shape[1], -np.inf
    width, last = turned.shape[1], turned.row == turned.shape[0] - 1
    rows = np.arange(len(turned.row))
    parity = int(turned.row[0] + turned.column[0]) % 2
    for columns in range(max(width - 2, 2), max(MOST_COLUMNS, width) + 1):
        for u in {-1, 0, 1, 2, 5, columns - width, columns - width + 1} & set(range(-1, columns - width + 2)):
            for v in range(-1, 2 * count // columns + 3):
                odd = (u + v + parity) % 2 == 1
                column, row = u + turned.column, v + turned.row
                on_board = (column >= 0) & (row >= 0) & (column < columns)
                marker = index_of(column, row, np.array(columns), np.array(odd))
                exists = on_board & (marker >= 0) & (marker < count)
                if (on_board & ~exists & ~last).any():
                    continue
                own = np.where(exists, gain[rows, np.clip(marker, 0, count - 1)], 0.0)
                best = max(best, own[~last].sum() + max(own[last].sum(), 0.0))
    return best


def freely(turned, gain):
    """The same where each outermost square may lie beyond the board by itself,
    and rows may begin a square to the side of the others."""
    count, (height, width), best = gain.shape[1], turned.shape, -np.inf
    squares = [np.flatnonzero(turned.row == r) for r in range(height)]
    first = np.arange(-200, count + 200)

    def likelihood(r, marker):
        total = np.zeros(len(marker))
        for j, k in enumerate(squares[r]):
            beside, last = turned.column[k] in (0, width - 1), r == height - 1
            own, known = marker + j, (marker + j >= 0) & (marker + j < count)
            there = gain[k, np.clip(own, 0, count - 1)]
            total += np.where(known, np.maximum(there, 0) if beside else there, 0 if beside or last else -1e6)
        return np.maximum(total, 0) if r in (0, height - 1) else total

    for columns in range(max(width - 2, 2), max(MOST_COLUMNS, width) + 1):
        right = int(turned.column[squares[0][0]] == 0)
        for step in range(columns // 2 - (1 - right), (columns + 1) // 2 + right + 1):
            rows = [likelihood(r, first + r // 2 * columns + r % 2 * step) for r in range(height)]
            best = max(best, np.sum(rows, axis=0).max())
    return best


@pytest.mark.parametrize(
    ("rows", "columns", "count", "first"), [(3, 3, 9, True), (4, 5, 40, False), (5, 4, 25, True), (6, 7, 61, False)]
)
def test_no_layout_has_more_evidence(rows, columns, count, first):
    shown, family = squares(rows, columns, rows, first=first), small(count)
    most = shown.most_evidence([family], -1e9)[0]
    for turns in range(4):
        turned = shown.turned(turns)
        gain = turned.gains(family, BORDER)
        true, free = likeliest(turned, gain), freely(turned, gain)
        assert true <= free <= most[turns]
        assert most[turns] <= free + (CHORDS + SLACK) * len(turned.row)


def test_boards_that_begin_with_any_marker_have_no_more_either():
    shown, family = squares(5, 6, 1), small(60)
    for turns, most in enumerate(shown.most_evidence([family], -1e9)[0]):
        turned = shown.turned(turns)
        gain, columns, rows = turned.gains(family, BORDER), turned.shape[1], np.arange(len(turned.row))
        odd = (turned.column[0] + turned.row[0]) % 2
        index = index_of(turned.column, turned.row, np.array(columns), np.array(odd, bool))
        whole = [gain[rows, first + index].sum() for first in range(len(family) - int(index.max()))]
        assert max(whole) <= most


def test_a_board_that_is_there_has_its_evidence():
    family = families(5)[0]
    shown = squares(4, 5, 0, side=5)
    row, column = np.nonzero(shown.marked)
    ratios = np.zeros((4, 5, 7, 7)) - 4.0
    marker = index_of(column, row, np.array(5), np.array(False))
    ratios[row, column, 1:-1, 1:-1] = np.where(family.bits[marker] > 0, 4.0, -4.0)
    there = MarkedSquares(ratios, shown.marked, np.ones((4, 5), bool), BORDER)
    most = there.most_evidence(families(5), -1e9)
    gain = there.turned(0).gains(family, BORDER)
    assert most[0, 0] == pytest.approx(gain[np.arange(len(marker)), marker].sum(), abs=CHORDS * len(marker))
    assert most[0, 0] > 200
    others = np.delete(most.ravel(), 0)
    assert others.max() < 100


@pytest.mark.parametrize("columns", [4, 5])
def test_the_mirror_image_is_told_from_the_picture_itself(columns):
    shown = squares(5, columns, 3)
    flipped = MarkedSquares(
        shown.ratios[:, ::-1, :, ::-1].copy(), shown.marked[:, ::-1].copy(), shown.inner[:, ::-1].copy(), BORDER
    )
    one, other = shown.most_evidence(families(4), 0.0, mirrored=True), flipped.most_evidence(families(4), 0.0)
    assert np.allclose(one, other, atol=1e-3)
    assert not np.allclose(one, shown.most_evidence(families(4), 0.0), atol=1)


def test_rows_by_themselves_are_enough_where_they_say_too_little():
    shown = squares(6, 7, 5)
    together, apart = shown.most_evidence(families(4), -1e9), shown.most_evidence(families(4), 1e9)
    assert (together <= apart + 1e-3).all()
    assert (together < apart - 1).any()
    limit = float(np.median(apart))
    mixed = shown.most_evidence(families(4), limit)
    assert np.allclose(mixed, np.where(apart >= limit, np.minimum(together, apart), apart), atol=1e-3)


def test_of_no_squares_nothing_is_told():
    none = MarkedSquares(np.zeros((3, 3, 6, 6)), np.zeros((3, 3), bool), np.ones((3, 3), bool), BORDER)
    assert (none.most_evidence(families(4), 0.0) == 0).all()

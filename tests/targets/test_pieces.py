"""Boards that covers, glare or markers break into pieces: pieces are read each, joined where they agree, and filled
where the print has corners."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from coded_scene import charuco, numbered, seen

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.synthetic import Background, BoardSpec, Scene, render
from rcdn.targets.complete import completed
from rcdn.targets.pieces import common, joined
from rcdn.targets.surroundings import surroundings
from rcdn.types import Charuco, PuzzleBoard


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig(target="auto"))


@pytest.fixture(scope="module")
def read(detector):
    """A picture, the board that was read on it, and where its corners are, by number."""
    drawing = charuco(8, 6, "DICT_4X4_50")
    image, xy = seen(drawing, turn=0.3)
    (board,) = detector.boards(image)
    return image, board, dict(zip(drawing.ids.tolist(), xy, strict=True))


def part(board, rows):
    pick = {name: getattr(board, name)[rows] for name in ("xy", "ij", "response", "status", "ids")}
    return replace(board, **pick, sigma=None)


def test_two_pieces_of_a_board_become_one(read):
    _, board, _ = read
    left, right = (part(board, np.flatnonzero(s)) for s in (board.ij[:, 0] <= 3, board.ij[:, 0] >= 3))
    whole = joined(left, right)
    np.testing.assert_array_equal(whole.ids, board.ids)
    np.testing.assert_array_equal(whole.xy, board.xy)


def test_two_boards_of_one_kind_stay_two(read):
    _, board, _ = read
    left, right = (part(board, np.flatnonzero(s)) for s in (board.ij[:, 0] <= 3, board.ij[:, 0] >= 3))
    assert joined(left, replace(right, xy=right.xy + np.array([60, 0]))) is None  # the same rows, on another plane
    assert joined(left, replace(left, xy=left.xy + np.array([200, 100]))) is None
    assert joined(left, replace(right, target=replace(right.target, legacy=True))) is None


def test_what_two_pieces_say_of_their_target_is_put_together():
    one = Charuco(8, None, "DICT_4X4_50", 0.75)
    assert common(one, replace(one, rows=6, dictionary="DICT_4X4_100")) == replace(
        one, rows=6, dictionary="DICT_4X4_100"
    )
    assert common(replace(one, rows=5), replace(one, rows=6)) is None
    assert common(one, replace(one, dictionary="DICT_5X5_50")) is None
    assert common(one, PuzzleBoard()) is None
    assert common(PuzzleBoard(), PuzzleBoard()) == PuzzleBoard()


def test_missing_corners_are_found_where_they_are_printed(read):
    image, board, place = read
    rng = np.random.default_rng(3)
    kept = np.sort(rng.choice(len(board), 18, replace=False))
    full = completed(image, part(board, kept))
    assert len(full) >= 0.9 * len(board)
    for number, at in zip(full.ids.tolist(), full.xy, strict=True):
        assert np.linalg.norm(place[number] - at) < 1.5


@pytest.mark.parametrize("first", [0, 1])
def test_rows_of_an_unknown_number_are_found_as_far_as_corners_are_seen(read, first):
    image, board, true = read
    some = part(board, np.flatnonzero((board.ij[:, 1] >= first) & (board.ij[:, 1] <= 2)))
    whole = completed(image.astype(np.float32), replace(some, target=replace(board.target, rows=None)))
    np.testing.assert_array_equal(whole.ids, np.arange(35))
    assert np.linalg.norm(whole.xy - [true[k] for k in range(35)], axis=1).max() < 0.5
    assert whole.target.rows is None


@pytest.mark.parametrize("shown", [1, 2, 7])
def test_a_row_that_was_not_read_needs_half_of_its_corners(read, shown):
    """The board ends with the fourth row if only a corner or two are seen in the fifth."""
    image, board, true = read
    hidden = image.copy()
    for k in range(28 + shown, 35):
        x, y = np.rint(true[k]).astype(int)
        hidden[y - 12 : y + 13, x - 12 : x + 13] = 128
    some = part(board, np.flatnonzero(board.ij[:, 1] <= 2))
    whole = completed(hidden.astype(np.float32), replace(some, target=replace(board.target, rows=None)))
    assert whole.ids.max() == (27 if shown < 4 else 34)
    told = completed(hidden.astype(np.float32), some)  # of a board of known size every corner counts
    assert told.ids.max() == 27 + shown


def test_rows_that_were_not_read_bring_the_dictionary_that_has_their_markers(detector):
    """The first rows need 36 markers, all of them 60: the print is known around each corner."""
    drawing = charuco(12, 10, "DICT_4X4_100")
    image, _ = seen(drawing, turn=0.3, size=0.95)
    (board,) = detector.boards(image)
    assert board.target.dictionary == "DICT_4X4_100"
    some = part(board, np.flatnonzero(board.ij[:, 1] <= 4))
    read = replace(some, target=replace(board.target, rows=None, dictionary="DICT_4X4_50"))
    whole = completed(image.astype(np.float32), read)
    assert len(whole) == len(board)
    assert whole.target.dictionary == "DICT_4X4_100"
    assert surroundings(image.astype(np.float32), whole) is not None


def test_a_corner_that_a_cover_moved_is_dropped_or_found_again(read):
    image, board, place = read
    for k in (0, 9, 17, 34):
        xy = board.xy.copy()
        xy[k] += 0.11 * np.linalg.norm(board.xy[1] - board.xy[0]) * np.array([0.8, 0.6])
        hidden = image.copy()
        cv2.circle(hidden, tuple(np.round(xy[k]).astype(int).tolist()), 12, 190, -1)
        kept = completed(hidden, replace(board, xy=xy))
        assert len(kept) >= len(board) - 1
        for number, at in zip(kept.ids.tolist(), kept.xy, strict=True):
            assert np.linalg.norm(place[number] - at) < 1.5


def test_nothing_is_added_under_a_cover_or_beyond_the_print(read):
    image, board, place = read
    kept = np.flatnonzero((board.ij[:, 0] <= 2) & (board.ij[:, 1] <= 3))
    covered = image.copy()
    hidden = [n for n, at in zip(board.ids.tolist(), board.ij.tolist(), strict=True) if at[0] >= 4]
    hull = cv2.convexHull(np.array([place[n] for n in hidden]).astype(np.float32))
    cv2.fillConvexPoly(covered, np.round(hull).astype(np.int32), 140)
    cv2.polylines(covered, [np.round(hull).astype(np.int32)], True, 140, 16)
    full = completed(covered, part(board, kept))
    assert len(full) >= len(kept)
    assert (full.ij <= [3, board.target.rows - 2]).all()
    for number, at in zip(full.ids.tolist(), full.xy, strict=True):
        assert np.linalg.norm(place[number] - at) < 1.5


def test_boards_under_glare_and_fingers_are_read(detector):
    """Ellipses across squares that leave no whole board; never a wrong number."""
    drawing, total, right_of_all = charuco(7, 6, "DICT_4X4_100"), 0, 0
    for seed in range(8):
        image, xy = seen(drawing, turn=0.5 * seed, seed=seed)
        rng = np.random.default_rng(seed)
        for at in xy[rng.choice(len(xy), 5, replace=False)]:
            angle = float(rng.uniform(0, 180))
            cv2.ellipse(image, tuple(np.round(at).astype(int).tolist()), (26, 9), angle, 0, 360, 190, -1, cv2.LINE_AA)
        right, wrong, shown = numbered(detector, image, drawing, xy)
        assert wrong == 0
        total, right_of_all = total + shown, right_of_all + right
    assert right_of_all >= 0.7 * total


def test_pieces_of_random_codes_have_no_numbers(detector):
    for seed in range(8):
        spec = BoardSpec(8, 6, (0.2, 0.1 * (seed % 4), 0.4 * seed), (-3.5, -2.5, 14.0), coded=4, swap=bool(seed % 2))
        scene = Scene(640, 480, 700.0, (319.5, 239.5), boards=(spec,), background=Background("plain", seed), seed=seed)
        image = render(scene).copy()
        rng = np.random.default_rng(seed)
        for x, y in rng.integers(0, (640, 480), (12, 2)).tolist():
            cv2.ellipse(image, (x, y), (50, 9), float(rng.uniform(0, 180)), 0, 360, 190, -1)
        assert all(board.target is None for board in detector.boards(image))


def test_pieces_of_a_legacy_board_do_not_say_where_it_ends(detector):
    """Moved by a column, a legacy board of an odd number of columns has the same markers in all squares of a piece."""
    drawing = charuco(11, 8, "DICT_ARUCO_ORIGINAL", legacy=True)
    for k in range(6):
        image, xy = seen(drawing, turn=np.pi / 2 * k + 0.05, shift=(170, 90), size=1.1, seed=k)
        cv2.line(image, (200 + 20 * k, 0), (330, 479), 128, 40)
        assert numbered(detector, image, drawing, xy)[1] == 0

"""Overlays: shapes, positions and what differs between statuses. Whether they please the eye, the eye must say."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.errors import ImageError
from rcdn.report import overlay
from rcdn.report.overlay import GREEN, PALETTE, RED, YELLOW, draw_overlay, enlargement
from rcdn.types import Board, Charuco, Corners, Status

NONE = Corners(np.zeros((0, 2)), [], [])


def make_board(cols=5, rows=4, start=(200.0, 150.0), step=60.0, status=Status.REFINED, keep=slice(None), wh=(900, 700)):
    ij = np.array([(i, j) for j in range(rows) for i in range(cols)])[keep]
    xy = np.array(start) + step * ij
    return Board(xy, ij, wh, np.ones(len(ij)), np.full(len(ij), int(status)), "unique")


def has(image, colour, tolerance=30):
    return (np.abs(image.astype(int) - colour).max(axis=-1) <= tolerance).any()


def centre_of(image, colour, tolerance=40):
    """Mean (x, y) of the pixels near a colour."""
    rows, cols = np.nonzero(np.abs(image.astype(int) - colour).max(axis=-1) <= tolerance)
    return np.array([cols.mean(), rows.mean()])


@pytest.mark.parametrize("shape", [(700, 900), (700, 900, 3), (700, 900, 4), (700, 900, 1)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_any_picture_gives_bgr_uint8(shape, dtype):
    image = np.arange(np.prod(shape)).reshape(shape) % 250
    before = image.astype(dtype)
    out = draw_overlay(before, NONE, [make_board()])
    assert out.shape == (700, 900, 3)
    assert out.dtype == np.uint8
    np.testing.assert_array_equal(before, image.astype(dtype))  # the input is not drawn on


@pytest.mark.parametrize("bad", [np.zeros(5), np.zeros((0, 4)), np.zeros((4, 4, 7))])
def test_what_is_no_picture_is_refused(bad):
    with pytest.raises(ImageError):
        draw_overlay(bad, NONE, [])


def test_nothing_found_leaves_a_dimmed_grey_picture():
    out = draw_overlay(np.full((700, 900), 255, np.uint8), NONE, [])
    assert (out == out[0, 0, 0]).all()
    assert out[0, 0, 0] < 200


@pytest.mark.parametrize(
    ("size", "scale"), [((2000, 1500), 1), ((800, 10), 1), ((640, 480), 2), ((320, 240), 4), ((1, 1), 16)]
)
def test_small_pictures_are_enlarged_by_a_whole_number(size, scale):
    assert enlargement(*size) == scale
    assert draw_overlay(np.zeros(size[::-1], np.uint8), NONE, []).shape == (size[1] * scale, size[0] * scale, 3)


@pytest.mark.parametrize(("width", "height"), [(1000, 800), (640, 480), (100, 90)])
@pytest.mark.parametrize("xy", [(40.0, 30.0), (40.37, 30.81)])
def test_positions_keep_to_pixel_centres(width, height, xy):
    scale = enlargement(width, height)
    out = draw_overlay(np.zeros((height, width), np.uint8), Corners([xy], [1.0], [0]), [])
    expected = (np.array(xy) + 0.5) * scale - 0.5
    np.testing.assert_allclose(centre_of(out, YELLOW, 100), expected, atol=0.3)


def test_enlarged_picture_and_drawing_agree():
    image = np.zeros((90, 100), np.uint8)
    image[30, 40] = 255  # one bright pixel, whose centre is (40, 30)
    bright = draw_overlay(image, NONE, [])[..., 0].astype(float)
    bright -= bright[0, 0]
    rows, cols = np.indices(bright.shape)
    middle = np.array([(cols * bright).sum(), (rows * bright).sum()]) / bright.sum()
    drawn = centre_of(draw_overlay(image * 0, Corners([(40, 30)], [1.0], [0]), []), YELLOW)
    np.testing.assert_allclose(middle, drawn, atol=0.4)


def test_loose_corners_are_yellow_and_those_of_boards_are_not():
    image, board = np.full((700, 900), 90, np.uint8), make_board()
    inside = Corners(board.xy + 0.1, np.ones(20), np.zeros(20))
    assert not has(draw_overlay(image, inside, [board]), YELLOW)
    outside = Corners([(700.0, 600.0)], [1.0], [0])
    assert has(draw_overlay(image, outside, [board])[590:611, 690:711], YELLOW)


def test_arrows_point_along_i_and_j():
    out = draw_overlay(np.full((700, 900), 90, np.uint8), NONE, [make_board(start=(200, 150), step=60)])
    red, green = centre_of(out, RED), centre_of(out, GREEN)
    assert 205 < red[0] < 255
    assert abs(red[1] - 150) < 12
    assert 155 < green[1] < 205
    assert abs(green[0] - 200) < 12


def test_each_status_looks_different():
    image = np.full((700, 900), 90, np.uint8)
    pictures = [draw_overlay(image, NONE, [make_board(status=s)])[240:301, 290:351] for s in Status]  # around (2, 2)
    assert all(not np.array_equal(a, b) for k, a in enumerate(pictures) for b in pictures[:k])


def test_boards_have_their_own_colours_and_captions_do_not_cover_each_other():
    image = np.full((700, 900), 90, np.uint8)
    boards = [make_board(3, 3, start=(60.0 + 150 * k, 100.0), step=40) for k in range(5)]
    out = draw_overlay(image, NONE, boards)
    for colour in PALETTE[:5]:
        assert has(out, colour)
    alone = draw_overlay(image, NONE, boards[:1])
    assert np.array_equal(out[:140, :80], alone[:140, :80])


@pytest.mark.parametrize(
    "board",
    [
        make_board(keep=np.arange(20) % 7 != 0),
        make_board(keep=[7]),
        make_board(keep=[0, 12]),
        make_board(keep=[]),
        make_board(step=0.5),
        make_board(start=(-500.0, 5000.0)),
        make_board(start=(9e6, -9e6)),
    ],
)
def test_odd_boards_are_drawn_without_trouble(board):
    assert draw_overlay(np.zeros((700, 900), np.uint8), NONE, [board]).shape == (700, 900, 3)


def test_same_input_gives_the_same_picture():
    image, board = np.random.default_rng(0).integers(0, 255, (480, 640), np.uint8), make_board(wh=(640, 480))
    np.testing.assert_array_equal(draw_overlay(image, NONE, [board]), draw_overlay(image, NONE, [board]))


def test_dark_pictures_are_lifted():
    image = np.tile(np.array([0, 12], np.uint8), (700, 450))
    out = draw_overlay(image, NONE, [])
    assert np.ptp(out) > 60


@pytest.mark.parametrize(("step", "every"), [(60.0, 1), (12.0, 2), (5.0, 4)])
def test_numbers_of_coded_boards_keep_apart(step, every, monkeypatch):
    """All where there is room; else every k-th and those of the board's corners.
    Each is written beside its own corner."""
    plain = make_board(11, 8, step=step)
    target = Charuco(12, 9, "DICT_4X4_250", 0.75)
    board = replace(plain, ij=plain.ij, target=target, ids=target.ids(plain.ij))
    written = {}
    monkeypatch.setattr(overlay._Canvas, "text", lambda self, text, xy, *a, **k: written.setdefault(text, xy))
    draw_overlay(np.zeros((700, 900), np.uint8), NONE, [board])
    numbers = {int(text): at for text, at in written.items() if text.isdigit()}
    assert {0, 10, 77, 87} <= numbers.keys()
    assert (len(numbers) == 88) == (every == 1)
    assert {n for n in numbers if (board.ij[n] % every == 0).all()} >= set(numbers) - {0, 10, 77, 87}
    for n, at in numbers.items():
        assert np.linalg.norm(at - plain.xy[n]) < 12
    kept = np.array([at for n, at in numbers.items() if (board.ij[n] % every == 0).all()])
    gaps = np.abs(kept[:, None] - kept)
    assert ((gaps[..., 0] > 15) | (gaps[..., 1] > 7) | (gaps.sum(axis=2) == 0)).all()


def test_numbers_are_drawn_on_coded_boards_only():
    plain = make_board()
    coded = replace(plain, target=(target := Charuco(6, 5, "DICT_4X4_50", 0.75)), ids=target.ids(plain.ij))
    image = np.zeros((700, 900), np.uint8)
    white = [(draw_overlay(image, NONE, [b])[160:320, 230:420] > 250).all(axis=2).sum() for b in (plain, coded)]
    assert white[0] == 0
    assert white[1] > 20

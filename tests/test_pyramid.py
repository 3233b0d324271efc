"""Looking at one picture at several scales: geometry of the views, and what becomes of boards seen twice."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rcdn
from rcdn.boards.of_views import adds_to, distinct_boards, distinct_corners
from rcdn.config import DetectorConfig
from rcdn.metrics import match
from rcdn.pyramid import (
    SMALL_PICTURE,
    View,
    at_the_frame,
    boards_in_picture,
    closer_view,
    faint_cells,
    halved_first,
    may_go_on,
    outside,
    plainly_seen,
    shown_nearby,
    unexplained,
    whole_views,
    without_gaps,
)
from rcdn.synthetic import ORDINARY, Background, BoardSpec, Scene, Sensor, random_scene, render, truth
from rcdn.types import Board, Corners, Status


def lattice(cols, rows, pitch, at=(50.0, 40.0), response=0.9):
    ij = np.array([(i, j) for j in range(rows) for i in range(cols)])
    status = np.full(len(ij), Status.REFINED)
    return Board(ij * pitch + at, ij, (640, 480), np.full(len(ij), response), status, "unique")


def front(cols, rows, pitch, size, noise=2.0, blur=0.7):
    """A board face on, its middle off the frame's by a few pixels."""
    t = (3.3 / pitch - (cols - 1) / 2, -2.2 / pitch - (rows - 1) / 2, 500 / pitch)
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    sensor = Sensor(blur=blur, noise=noise)
    boards = (BoardSpec(cols, rows, (0.0, 0.0, 0.0), t),)
    return Scene(*size, 500, centre, boards=boards, sensor=sensor, background=Background("plain", 3), seed=4)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.integers(0, 90),
    st.integers(0, 70),
    st.integers(24, 120),
    st.integers(24, 110),
    st.sampled_from([2.0, 1.0, 0.5, 0.25]),
)
def test_a_blob_is_where_its_view_says(x, y, width, height, scale):
    """A smooth blob's centre of mass in the view, taken back, is its place in the picture."""
    spot = np.array([x + width / 2, y + height / 2])
    rows, cols = np.mgrid[:200, :240]
    grey = np.exp(-((cols - spot[0]) ** 2 + (rows - spot[1]) ** 2) / (2 * (min(width, height) / 8) ** 2)).astype(
        np.float32
    )
    view = View((x, y, x + width, y + height), scale)
    part = view.of(grey).astype(float)
    py, px = np.mgrid[: part.shape[0], : part.shape[1]]
    centre = np.array([(part * px).sum(), (part * py).sum()]) / part.sum()
    assert np.abs(view.to_picture(centre[None]) - spot).max() < 0.05


def test_the_picture_as_it_is_comes_first_and_nothing_moves_in_it():
    views = whole_views((480, 640))
    grey = np.arange(480 * 640).reshape(480, 640) % 251
    assert views[0].scale == 1
    assert views[0].of(grey) is not None
    assert np.array_equal(views[0].of(grey), grey)
    xy = np.random.default_rng(0).uniform(0, 400, (50, 2))
    assert np.array_equal(views[0].to_picture(xy), xy)


@pytest.mark.parametrize(
    ("shape", "scales"),
    [((120, 160), [1, 2]), ((480, 640), [1, 0.5, 0.25]), ((3000, 4000), [1, 0.5, 0.25, 0.125]), ((5, 5), [1, 2])],
)
def test_small_pictures_are_enlarged_and_large_ones_reduced(shape, scales):
    assert [v.scale for v in whole_views(shape)] == scales


def test_a_closer_look_goes_where_tiny_squares_are():
    tiny = lattice(9, 6, 6.0, at=(300, 200)).xy
    wide = lattice(7, 5, 40.0, at=(100, 100)).xy
    assert closer_view(wide, [], (480, 640)) is None
    assert closer_view(tiny[:8], [], (480, 640)) is None
    view = closer_view(np.concatenate([tiny, wide]), [], (480, 640))
    x0, y0, x1, y1 = view.box
    assert view.scale == 2
    assert x0 < 300 - 6 < 300 + 54 < x1 < 500
    assert y0 < 200 - 6 < 200 + 36 < y1 < 400
    assert closer_view(tiny, [lattice(9, 6, 20.0, at=(260, 180))], (480, 640)) is None


def test_of_a_board_seen_twice_the_fuller_stands():
    full, part = lattice(9, 6, 20.0), lattice(6, 6, 20.0, at=(50.4, 40.3))
    away = lattice(4, 4, 20.0, at=(400, 300))
    assert [len(b) for b in distinct_boards([[part, away], [full]])] == [54, 16]
    assert distinct_boards([[full], [lattice(9, 6, 20.0, at=(50.2, 40.0))]])[0] is full


def test_markers_inside_a_board_are_no_boards():
    full, inner = lattice(9, 6, 20.0), lattice(3, 3, 4.0, at=(75, 65))
    assert distinct_boards([[full], [inner]]) == [full]


def test_a_board_adds_to_those_that_it_has_corners_of():
    part, away = lattice(8, 6, 20.0, at=(50.4, 40.3)), lattice(9, 9, 20.0, at=(400, 200))
    assert adds_to(lattice(9, 6, 20.0), [part, away], 6)
    assert not adds_to(lattice(9, 6, 20.0), [part, away], 7)
    assert not adds_to(part, [lattice(9, 6, 20.0)], 1)
    assert adds_to(part, [away], 1)
    assert adds_to(part, [], 1)


def test_a_board_in_a_gap_of_a_larger_one_stands_before_it():
    floor, board = lattice(15, 12, 20.0), lattice(4, 3, 15.0, at=(160, 130))
    gap = (np.abs(floor.xy - board.xy.mean(axis=0)) > (50, 42)).any(axis=1)
    around = Board(floor.xy[gap], floor.ij[gap], floor.image_size, floor.response[gap], floor.status[gap], "unique")
    assert distinct_boards([[around, board]]) == [around, board]
    assert distinct_boards([[floor, board]]) == [floor]


def test_a_board_in_a_gap_stands_though_the_larger_one_has_taken_corners_of_it():
    """A few squares of a wide gap: most of its corners are near those around."""
    floor, board = lattice(12, 9, 40.0), lattice(6, 4, 14.0, at=(259, 171))
    gap = (np.abs(floor.xy - board.xy.mean(axis=0)) > (52, 38)).any(axis=1)
    xy, taken = floor.xy.copy(), int(np.flatnonzero(~gap)[0])
    xy[taken] = board.xy[np.argmin(np.hypot(*(board.xy - xy[taken]).T))] + 0.3
    gap[taken] = True
    around = Board(xy[gap], floor.ij[gap], floor.image_size, floor.response[gap], floor.status[gap], "unique")
    assert distinct_boards([[around, board]]) == [around, board]
    whole = Board(xy, floor.ij, floor.image_size, floor.response, floor.status, "unique")
    assert distinct_boards([[whole, board]]) == [whole]


@pytest.mark.parametrize("turned", [0.0, 0.35])
def test_a_board_is_found_before_a_checkered_floor(turned):
    """Floor and board of about the same squares; the board's paper covers what is under it."""
    rows, cols = np.mgrid[:480, :640]
    floor = np.where((rows // 30 + cols // 30) % 2, 60.0, 190.0)
    c, s = np.cos(turned), np.sin(turned)
    x, y = c * (cols - 330.3) + s * (rows - 241.7), -s * (cols - 330.3) + c * (rows - 241.7)
    i, j = np.floor(x / 24).astype(int), np.floor(y / 24).astype(int)
    paper = (np.abs(x) < 24 * 5) & (np.abs(y) < 24 * 4)
    squares = (np.abs(x) < 24 * 4) & (np.abs(y) < 24 * 3) & ((i + j) % 2 == 1)
    image = cv2.GaussianBlur(np.where(squares, 20.0, np.where(paper, 230.0, floor)), (0, 0), 0.8)
    image += np.random.default_rng(3).normal(0, 2, image.shape)
    near = [b for b in rcdn.Detector().boards(image.clip(0, 255).astype(np.uint8)) if b.size in {(7, 5), (5, 7)}]
    assert len(near) == 1
    at = 24.0 * np.array([(a, b) for b in range(-2, 3) for a in range(-3, 4)]) @ [[c, s], [-s, c]] + [330.3, 241.7]
    assert len(match(near[0].xy, at, 0.7)[0]) == 35


def test_corners_of_several_lists_are_kept_once_and_sorted():
    rng = np.random.default_rng(1)
    a = Corners(rng.uniform(0, 500, (40, 2)), rng.uniform(0, 1, 40), np.zeros(40), axes=np.tile([0.1, 1.6], (40, 1)))
    b = Corners(np.concatenate([a.xy + 0.5, [[600, 400]]]), np.ones(41), np.zeros(41))
    out = distinct_corners([a, b])
    assert len(out) == 41
    assert (np.diff(out.response) <= 0).all()
    assert np.isnan(out.axes[(out.xy == [600, 400]).all(axis=1)]).all()
    assert {tuple(p) for p in a.xy} < {tuple(p) for p in out.xy}


@pytest.mark.parametrize(("pitch", "size"), [(3.6, (160, 120)), (4.6, (160, 120)), (6.0, (640, 480))])
def test_boards_of_tiny_squares_are_found_whole(pitch, size):
    scene = front(9, 6, pitch, size, blur=0.5)
    (board,) = rcdn.Detector().boards(render(scene))
    pairs, gaps = match(board.xy, truth(scene)[0].xy, 0.4 * pitch)
    assert len(pairs) == len(board) == 54
    assert gaps.mean() < 0.06


def test_boards_too_blurred_for_full_size_are_found_reduced():
    scene = front(7, 5, 110.0, (1200, 900), blur=15.0)
    grey = render(scene, samples=1)
    (board,) = rcdn.Detector().boards(grey)
    pairs, gaps = match(board.xy, truth(scene)[0].xy, 10)
    assert len(pairs) == len(board) == 35
    assert gaps.mean() < 0.5
    assert len(rcdn.Detector(DetectorConfig.auto(pyramid=False)).boards(grey)) == 0


def test_every_corner_of_a_board_is_among_the_corners():
    grey = cv2.resize(render(front(9, 6, 30.0, (640, 480))), None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    found = rcdn.Detector().detect(grey)
    assert len(found.boards) == 1
    assert {tuple(p) for p in found.boards[0].xy} <= {tuple(p) for p in found.corners.xy}


@pytest.mark.parametrize(
    ("pitch", "size", "stays"), [(4.3, (640, 480), False), (4.3, (160, 120), True), (6.0, (640, 480), True)]
)
def test_tiny_squares_in_a_corner_of_the_picture_are_a_grille(pitch, size, stays):
    board = lattice(9, 6, 2 * pitch)
    view = View((0, 0, *size), 2.0)
    found = boards_in_picture(view, [board], size[::-1])
    assert len(found) == stays
    assert all(b.image_size == size for b in found)


HALF = View((0, 0, 640, 480), 0.5)
"""a reduced view"""


def in_view(xy):
    """Positions of the picture in `HALF`."""
    return (np.asarray(xy, float) + 0.5) / 2 - 0.5


def test_peaks_inside_a_complete_board_are_known():
    board = lattice(9, 6, 20.0)
    away = np.array([[400.0, 300.0], [30.0, 140.0]])
    left = unexplained(HALF, in_view(np.concatenate([board.xy, away])), [board])
    rim = (board.ij == 0).any(axis=1) | (board.ij == board.ij.max(axis=0)).any(axis=1)
    assert left.tolist() == [*rim.tolist(), True, True]


@pytest.mark.parametrize("side", [[(9, j) for j in range(6)], [(-1, j) for j in range(6)], [(i, 6) for i in range(9)]])
def test_a_board_may_go_on_where_strong_peaks_stand_beyond_a_side(side):
    board = lattice(9, 6, 20.0)
    more = np.array(side) * 20.0 + (50, 40)
    assert may_go_on(HALF, in_view(np.concatenate([board.xy, more])), [board])
    assert not may_go_on(HALF, in_view(np.concatenate([board.xy, more[:2]])), [board])


def test_boards_with_holes_and_thin_ones_explain_nothing():
    full, thin = lattice(9, 6, 20.0), lattice(9, 2, 20.0, at=(50, 300))
    keep = np.arange(54) != 20
    holed = Board(full.xy[keep], full.ij[keep], (640, 480), np.ones(53), np.zeros(53), "unique")
    for boards in ([], [holed], [full, thin]):
        assert not without_gaps(boards)
    assert without_gaps([full])
    assert unexplained(HALF, np.zeros((0, 2)), [full]).shape == (0,)


def test_cells_on_and_inside_of_a_board_are_not_looked_at():
    board, cells = lattice(9, 6, 20.0), np.ones((60, 80), bool)  # its corners from (50, 40) to (210, 140)
    left = outside(HALF, cells, [board])
    y, x = (8 * (n + 0.5) for n in np.mgrid[:60, :80])
    gap = np.maximum(np.maximum(50 - x, x - 210), np.maximum(40 - y, y - 140))
    corner = np.hypot((x - 50 + 10) % 20 - 10, (y - 40 + 10) % 20 - 10) < 5
    assert left[gap > 8].all()
    assert not left[gap < -19].any()
    assert not left[corner & (gap < 5)].any()


def test_a_board_is_plainly_seen_if_nothing_can_follow_it():
    board, none = lattice(9, 6, 20.0), np.zeros((0, 2))  # its corners from (50, 40) to (210, 140)
    frame = (180, 260)
    assert plainly_seen([board], none, frame)
    assert plainly_seen([board], board.xy, frame)
    assert plainly_seen([board], np.array([[240.0, 60.0]]), frame)
    assert not plainly_seen([board], np.array([[231.0, 61.0]]), frame)  # a corner of a tenth column
    assert not plainly_seen([board], none, (165, 260))  # a seventh row at 160 would lie at the frame
    assert not plainly_seen([board], none, (180, 235))
    assert plainly_seen([board], none, (150, 260))  # there is no room for a seventh row
    assert not plainly_seen([board], none, (158, 260))  # there may be
    assert not plainly_seen([board, lattice(4, 4, 9.0, at=(100, 80))], none, frame)  # squares too small
    assert not plainly_seen([], none, frame)


def test_squares_that_a_reduced_view_is_too_small_for_are_not_plainly_seen():
    none, frame = np.zeros((0, 2)), (480, 640)
    for pitch, plain in ((12.5, True), (11.5, False)):
        assert plainly_seen([lattice(9, 6, pitch)], none, frame, 0.5) == plain


@pytest.mark.parametrize(("shape", "halved"), [((240, 320), False), ((480, 640), True), ((3000, 4000), True)])
def test_a_large_picture_is_looked_at_halved_first(shape, halved):
    view = halved_first(whole_views(shape))
    assert (view is not None) == halved
    assert view is None or view.scale == 0.5


def test_where_a_coarser_view_shows_corners_the_finer_one_may_show_more():
    response, shape = np.zeros((240, 320), np.float32), (479, 639)
    assert not shown_nearby(response, [], shape).any()
    response[100, 150] = 0.9
    cells = shown_nearby(response, [], shape)
    y, x = (4 * n + 1.5 for n in np.nonzero(cells))
    assert cells.shape == (120, 160)
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((301 - 96, 301 + 96, 201 - 96, 201 + 96), abs=4)
    board = lattice(4, 3, 30.0, at=(400, 60))
    cells = shown_nearby(np.zeros_like(response), [board], shape)
    y, x = (4 * n + 1.5 for n in np.nonzero(cells))
    assert (x.min(), x.max(), y.min(), y.max()) == pytest.approx((355, 535, 15, 165), abs=4)


def test_a_dense_answer_of_the_half_is_looked_at_in_the_picture_itself():
    response, shape = np.zeros((240, 320), np.float32), (480, 640)
    response[100:118:4, 150:172:4] = 0.5  # 5 × 6 corners of squares of 8 px in the picture
    dense = cv2.dilate(response, np.ones((2, 2)))
    assert faint_cells(dense, shape)[54, 79]
    assert not faint_cells(0.4 * dense, shape).any()
    response[:] = 0
    response[100, 150] = response[140, 180] = response[100, 170] = 0.9
    assert not faint_cells(response, shape).any()


def test_places_at_the_frame_are_where_a_board_may_go_on_unseen():
    board = lattice(9, 6, 20.0)  # its corners from (50, 40) to (210, 140)
    assert not at_the_frame([board], (180, 260)).any()
    assert not at_the_frame([board], (145, 260)).any()  # no room for a row at 160
    cells = at_the_frame([board], (165, 260))
    y, x = (4 * n + 1.5 for n in np.nonzero(cells))
    assert (y.min(), y.max()) == pytest.approx((152.5, 164), abs=4)
    assert (x.min(), x.max()) == pytest.approx((42.5, 217.5), abs=4)
    assert all(cells[40, int(i) // 4] for i in range(50, 211, 20))


def test_one_corner_at_the_frame_is_enough_for_a_board_to_go_on():
    board, whole = lattice(9, 6, 20.0), View((0, 0, 260, 165))
    at = np.array([[90.0, 160.0]])
    assert may_go_on(whole, at, [board], (165, 260))
    assert not may_go_on(whole, at, [board])
    assert not may_go_on(whole, at, [board], (180, 260))


def small_picture(pitch, size=(7, 5), frame=(320, 240)):
    return render(front(*size, pitch, frame))


@pytest.mark.parametrize("pitch", [12.0, 18.0, 25.0])
def test_an_enlarged_view_of_a_board_that_is_plainly_seen_would_show_nothing_new(pitch, monkeypatch):
    grey = small_picture(pitch)
    calls = []
    monkeypatch.setattr(View, "to_picture", watched(View.to_picture, calls))
    quick = rcdn.Detector().boards(grey)
    assert not any(view.scale > 1 for view in calls)
    monkeypatch.setattr("rcdn.views.plainly_seen", lambda *_: False)
    slow = rcdn.Detector().boards(grey)
    assert any(view.scale > 1 for view in calls)
    assert [b.xy.tobytes() for b in quick] == [b.xy.tobytes() for b in slow]
    assert [len(b) for b in quick] == [35]


def watched(method, calls):
    """The method of a view, the views that it is called of noted."""

    def call(view, *arguments):
        calls.append(view)
        return method(view, *arguments)

    return call


def test_tiny_squares_beside_a_board_that_is_plainly_seen_are_enlarged():
    grey = np.concatenate([small_picture(14.0, (5, 4), (160, 200)), small_picture(6.0, (7, 5), (140, 200))], axis=1)
    assert grey.size <= SMALL_PICTURE
    assert [len(b) for b in rcdn.Detector().boards(grey)] == [35, 20]


def two_boards(near, far_blur):
    """A sharp board and one so far out of focus that only a reduced view shows it, in one picture."""
    sharp = render(front(7, 5, near, (640, 480)))
    soft = render(front(5, 4, 90.0, (640, 480), blur=far_blur))
    return np.concatenate([sharp, soft], axis=1)


def test_a_complete_board_does_not_hide_another_that_only_a_reduced_view_shows():
    grey = two_boards(40.0, 13.0)
    found = rcdn.Detector().boards(grey)
    assert [len(b) for b in found] == [35, 20]
    assert len(rcdn.Detector(DetectorConfig.auto(pyramid=False)).boards(grey)) == 1


@pytest.mark.parametrize("seed", range(4))
def test_views_that_are_passed_over_would_have_shown_nothing_new(seed, monkeypatch):
    grey = render(random_scene(np.random.default_rng(seed), ORDINARY, (480, 360)))
    quick = rcdn.Detector().detect(grey)
    monkeypatch.setattr("rcdn.views.without_gaps", lambda *_: False)
    slow = rcdn.Detector().detect(grey)
    assert [b.xy.tobytes() for b in quick.boards] == [b.xy.tobytes() for b in slow.boards]
    assert quick.corners.xy.tobytes() == slow.corners.xy.tobytes()

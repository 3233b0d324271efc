"""Boards of very many corners come out whole, work grows in proportion to the picture,
and what a limit leaves out is told."""

from importlib import import_module

import numpy as np
import pytest

from rcdn.boards.graph import Field
from rcdn.boards.local import Grid
from rcdn.boards.merge import merge
from rcdn.boards.of_views import SAME, distinct_boards
from rcdn.config import DetectorConfig, Nms
from rcdn.corners.nms import nms
from rcdn.detector import Detector
from rcdn.geometry.boxes import BoxCells, PointCells
from rcdn.geometry.near import nearest
from rcdn.geometry.polygon import deeper, depth, least_depth
from rcdn.io import ImageResult
from rcdn.io.formats import image_line, image_of_line
from rcdn.types import Board, Status, Warnings, allowed
from rcdn_lab.worst_case import checkers


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig(threads=1))


def whole(board, columns, rows, pitch, size, angle=0.0):
    """Is a board all of a centred lattice's inner corners, each under its own label?"""
    ij = board.ij - (np.array(board.size) - 1) / 2
    c, s = np.cos(angle), np.sin(angle)
    turns = [pitch * ij @ np.linalg.matrix_power(np.array([[0, 1], [-1, 0]]), k) @ [[c, s], [-s, c]] for k in range(4)]
    off = min(np.abs(board.xy - np.array(size) / 2 - t).max() for t in turns)
    return sorted(board.size) == sorted((columns - 1, rows - 1)) and board.complete and off < 0.5


@pytest.mark.parametrize(("size", "pitch"), [((866, 1155), 5), ((1000, 1000), 6)])
def test_a_board_of_more_than_20_000_corners_is_whole(detector, size, pitch):
    found = detector.detect(checkers.board(size, pitch))
    columns, rows = (int((n - 3 * pitch) / pitch) for n in size)
    assert [len(b) for b in found.boards] == [(columns - 1) * (rows - 1)]
    assert whole(found.boards[0], columns, rows, pitch, size)
    filled, fitted = found.warnings
    assert "corners and more" in filled
    assert "no sigma" in fitted


def test_a_board_of_100_000_corners_is_whole(detector):
    found = detector.detect(checkers.board((2000, 2000), 6.25))
    (board,) = found.boards
    assert len(board) == 99_856
    assert whole(board, 317, 317, 6.25, (2000, 2000))
    assert board.sigma is None
    assert np.isnan(found.corners.sigma).all()


def test_a_usual_board_has_no_warnings(detector):
    found = detector.detect(checkers.board((640, 480), 30, 0.05))
    assert found.boards
    assert found.warnings == ()


def test_of_hundreds_of_boards_the_largest_are_kept_and_it_is_told(detector):
    image = checkers.many((1000, 1000), 4, 8, 6)
    image[:200, :200] = checkers.board((200, 200), 14)
    found = detector.detect(image)
    assert len(found.boards) == 50
    assert len(found.boards[0]) > 50
    assert any("boards only the 50 largest" in text for text in found.warnings)
    assert len(found.corners) > 3000  # corners by themselves stay


def test_pieces_that_take_too_many_rounds_are_told(detector):
    found = detector.detect(checkers.flipped((600, 600), 8, 0.1, 2))
    assert any("too many rounds" in text for text in found.warnings)


def test_a_whole_board_is_not_said_to_lack_corners(detector, monkeypatch):
    monkeypatch.setattr(import_module("rcdn.boards"), "GROWN", (0, 0))
    found = detector.detect(checkers.board((640, 480), 30, 0.05))
    assert found.boards[0].complete
    assert found.warnings == ()


@pytest.mark.parametrize("image", [checkers.holed((300, 300), 8, 30, 60), checkers.flipped((300, 300), 10, 0.05, 4)])
def test_a_grid_asks_only_near_what_was_added_and_grows_as_if_it_asked_everywhere(detector, monkeypatch, image):
    some = detector.detect(image)
    monkeypatch.setattr(import_module("rcdn.boards.grow"), "MANY", 1_000_000)
    every = detector.detect(image)
    assert some.boards
    assert len(some.boards) == len(every.boards)
    for one, other in zip(some.boards, every.boards, strict=True):
        assert np.array_equal(one.xy, other.xy)
        assert np.array_equal(one.ij, other.ij)


def test_peaks_beyond_the_limit_are_told():
    response = np.tile(np.array([[1, 0], [0, 0]], np.float32), (20, 20))
    warnings = Warnings()
    xy, _ = nms(response, 0.5, Nms(1, peaks=True), limit=150, warnings=warnings)
    assert len(xy) == 150
    assert warnings.texts == ("of 400 places that may be corners only the 150 strongest were looked at",)
    warnings = Warnings()
    assert len(nms(response, 0.5, Nms(1, peaks=True), warnings=warnings)[0]) == 400
    assert warnings.texts == ()


def test_each_kind_of_warning_is_told_once():
    warnings = Warnings()
    warnings.add("a", "one")
    warnings.add("b", "two")
    warnings.add("a", "three")
    assert warnings.texts == ("one", "two")


def test_limits_grow_with_the_picture():
    assert allowed(10_000, 25, 100) == 25
    assert allowed(12_000_000, 25, 100) == 1200


def test_warnings_are_in_the_file_where_there_are_any(detector):
    found = detector.detect(checkers.board((320, 250), 30))
    plain = ImageResult("a.png", 320, 250, found.corners, tuple(found.boards))
    assert "warnings" not in image_line(plain)
    warnings = ImageResult("a.png", 320, 250, found.corners, tuple(found.boards), ("one", "two"))
    assert image_of_line(image_line(warnings)).warnings == ("one", "two")
    assert image_of_line(image_line(plain)).warnings == ()


# ---- the quick against the obvious


def lattice(rng, bounds=600):
    cols, rows = rng.integers(3, 7, 2)
    ij = np.array([(i, j) for j in range(rows) for i in range(cols)])
    pitch, angle = rng.uniform(5, 40), rng.uniform(-0.7, 0.7)
    c, s = np.cos(angle), np.sin(angle)
    xy = ij * pitch @ [[c, s], [-s, c]] + rng.uniform(0, bounds, 2)
    return Board(xy, ij, (bounds, bounds), np.full(len(ij), 0.9), np.full(len(ij), Status.REFINED), "unique")


def shifted(board, by, rng):
    keep = np.sort(rng.choice(len(board), max(len(board) - 2, 4), replace=False))
    ij = board.ij[keep] - board.ij[keep].min(axis=0)
    return Board(board.xy[keep] + by, ij, board.image_size, board.response[keep], board.status[keep], "unique")


def pitch_of(board):
    return float(np.median(nearest(board.xy, board.xy, 2)[0][:, 1]))


def obvious(found):
    """Each board against all that were kept."""
    import cv2

    def shares(board, other):
        if (nearest(other.xy, board.xy)[0][:, 0] < SAME * pitch_of(other)).mean() > 0.25:
            return True
        inside = depth(cv2.convexHull(other.xy.astype(np.float32)), board.xy) >= -1e-3
        steps = np.linalg.norm(board.xy[:, None] - other.xy, axis=2)
        steps /= np.sort(np.linalg.norm(other.xy[:, None] - other.xy, axis=2), axis=1)[:, 1]
        small = np.ptp(board.xy, axis=0).max() < 1.5 * pitch_of(other)
        nearest_one = np.linalg.norm(board.xy[:, None] - other.xy, axis=2).argmin(axis=1)
        among = steps[np.arange(len(board)), nearest_one] < 0.9
        return inside.mean() > 0.5 and (small or (inside & among).mean() > 0.5)

    ranked = sorted(((len(b), -k, b) for k, part in enumerate(found) for b in part), key=lambda r: r[:2], reverse=True)
    kept = []
    for _, _, board in ranked:
        if not any(shares(board, other) for other in kept):
            kept.append(board)
    return sorted(kept, key=lambda b: (-len(b), *b.xy[0]))


@pytest.mark.parametrize("seed", range(12))
def test_distinct_boards_are_those_of_the_obvious_way(seed):
    rng = np.random.default_rng(seed)
    first = [lattice(rng) for _ in range(40)]
    second = [shifted(b, rng.normal(0, 2, 2), rng) for b in first[::2]] + [lattice(rng) for _ in range(15)]
    new, old = distinct_boards([first, second]), obvious([first, second])
    assert list(map(id, new)) == list(map(id, old))


@pytest.mark.parametrize("seed", range(5))
def test_points_in_boxes_and_boxes_that_touch(seed):
    rng = np.random.default_rng(seed)
    points = rng.uniform(0, [900, 60], (3000, 2)).round()
    points[::97] = -1e6
    cells = PointCells(points)
    low, high = rng.uniform(-20, [900, 60], (200, 2)), rng.uniform(0, 90, (200, 2))
    for a, b in zip(low, low + high, strict=True):
        assert np.array_equal(cells.inside(a, b), np.flatnonzero(((points >= a) & (points <= b)).all(axis=1)))
    boxes = BoxCells(low, low + high)
    for a, b in zip(low, low + high, strict=True):
        assert boxes.touched(a, b) == np.flatnonzero(((low <= b) & (low + high >= a)).all(axis=1)).tolist()


@pytest.mark.parametrize("height", [1.0, 0.05])
@pytest.mark.parametrize("sides", [3, 40, 500])
def test_how_deep_points_lie_is_told_without_all_sides(sides, height):
    rng = np.random.default_rng(sides)
    angle = np.sort(rng.uniform(0, 2 * np.pi, sides))
    outline = (100 + 20 * np.sin(7 * angle))[:, None] * np.stack([np.cos(angle), height * np.sin(angle)], axis=1)
    at = rng.uniform(-130, 130, (2000, 2)) * [1, height]
    for limit in (0.0, 3.0, 40.0):
        assert np.array_equal(deeper(outline, at, limit), depth(outline, at) > limit)
    inner = at[depth(outline, at) > 5 * height]
    assert least_depth(outline, inner) == pytest.approx(depth(outline, inner).min(), rel=1e-8)
    assert least_depth(outline, at) == pytest.approx(depth(outline, at).min(), rel=1e-8)


# ---- work, counted


@pytest.fixture
def work(monkeypatch):
    """Numbers of points and places that went through kernels of neighbours and of polygons."""
    near, polygon = import_module("rcdn.geometry.near"), import_module("rcdn.geometry.polygon")
    counts = {"near": 0, "polygon": 0}

    def counted(name, function, size):
        def call(*values):
            counts[name] += size(values)
            return function(*values)

        return call

    for kernel in ("_nearest", "_within"):
        monkeypatch.setattr(near, kernel, counted("near", getattr(near, kernel), lambda v: len(v[0]) + len(v[1])))
    monkeypatch.setattr(polygon, "_depth", counted("polygon", polygon._depth, lambda v: len(v[0]) * len(v[1])))
    return counts


def spread(count):
    """`count` × `count` small boards in rows."""
    rng = np.random.default_rng(7)
    boards = []
    for place in np.ndindex(count, count):
        ij = np.array([(i, j) for j in range(4) for i in range(4)])
        xy = ij * 8.0 + np.array(place) * 40 + rng.normal(0, 0.05, (16, 2))
        boards.append(Board(xy, ij, (9999, 9999), np.full(16, 0.9), np.full(16, Status.REFINED), "ambiguous_90"))
    return boards


def test_telling_boards_apart_grows_with_their_number(work):
    seen = []
    for count in (12, 24):
        boards = spread(count)
        work.update(near=0, polygon=0)
        assert len(distinct_boards([boards, boards])) == count * count
        seen.append(sum(work.values()))
    assert seen[1] < 5 * seen[0]


def torn(count):
    """A lattice of `count` × `count` blocks of 4 × 4 corners, each a grid of its own,
    every other line between them lost."""
    step, grids, xy = 5, [], []
    for a, b in np.ndindex(count, count):
        ij = np.array([(u, v) for v in range(4) for u in range(4)])
        grids.append({(u, v): len(xy) + k for k, (u, v) in enumerate(ij.tolist())})
        xy += ((ij + np.array([a, b]) * step) * 10.0).tolist()
    positions = np.array(xy)
    labels = np.rint(positions / 10).astype(int)
    parity = 1 - 2 * (labels.sum(axis=1) % 2)
    axes = np.tile([0.0, np.pi / 2], (len(positions), 1))
    one = np.ones(len(positions))
    field = Field(np.zeros((9, 9), np.uint8), positions, axes, parity, one, one, one, one > 0, one > 0)
    return field, [Grid(at, positions) for at in grids]


def test_joining_parts_grows_with_their_number(monkeypatch):
    """Attempts to join, and predictions made for them."""
    module, local = import_module("rcdn.boards.merge"), import_module("rcdn.boards.local")
    seen = []
    attempts, predicted = [0], [0]
    join, predict = module._motion, local._predict

    def counted(*given):
        attempts[0] += 1
        return join(*given)

    def counted_predict(*given):
        predicted[0] += len(given[2])
        return predict(*given)

    monkeypatch.setattr(module, "_motion", counted)
    monkeypatch.setattr(local, "_predict", counted_predict)
    for count in (6, 12):
        attempts[0] = predicted[0] = 0
        field, grids = torn(count)
        (joined,) = merge(field, grids)
        assert len(joined) == 16 * count * count
        seen.append((attempts[0], predicted[0]))
    assert seen[1][0] < 5 * seen[0][0]
    assert seen[1][1] < 6 * seen[0][1]

"""corners.vnl as boards: the way back from what is written, the grid's size, mirrored labels,
sizes of pictures, refusals."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rcdn.errors import FormatError
from rcdn.io import ImageResult, read_vnl, read_vnl_boards, write_image, write_vnl
from rcdn.types import AprilGrid, Board, Charuco, Corners, PuzzleBoard, Status

SIZE = (640, 480)


def tilted(cols, rows, drop=(), seed=0):
    """A board in perspective, turned by up to a quarter either way, inside the picture."""
    rng = np.random.default_rng(seed)
    ij = np.array([(i, j) for j in range(rows) for i in range(cols) if (i, j) not in drop])
    x, y = ((ij - [(cols - 1) / 2, (rows - 1) / 2]) / max(cols, rows)).T
    turn = rng.uniform(-1.5, 1.5)
    depth = 1 + rng.uniform(-0.5, 0.5) * x + rng.uniform(-0.5, 0.5) * y
    u, v = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
    xy = np.round(np.stack([320 + 210 * u / depth, 240 + 210 * v / depth], axis=-1), 4)
    n = len(ij)
    return Board(xy, ij, SIZE, np.ones(n), np.zeros(n), "unique")


def result(path, *boards):
    return ImageResult(path, *SIZE, Corners(np.zeros((0, 2)), np.zeros(0), np.zeros(0)), boards)


def same_board(a, b):
    np.testing.assert_array_equal(a.ij, b.ij)
    np.testing.assert_array_equal(a.xy, b.xy)


SIZES = st.tuples(st.integers(2, 9), st.integers(2, 9))
HOLES = st.sets(st.tuples(st.integers(0, 8), st.integers(0, 8)), max_size=5)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(SIZES, HOLES, st.integers(0, 1000))
def test_round_trip(tmp_path, size, drop, seed):
    cols, rows = size
    whole, holes = tilted(*size, seed=seed), tilted(*size, drop - {(0, 0), (cols - 1, rows - 1)}, seed=seed + 1)
    write_vnl(tmp_path / "c.vnl", [result("x/a.png", whole), result("b.png"), result("c.png", holes)], size)
    a, b, c = read_vnl_boards(tmp_path / "c.vnl", size, SIZE)
    assert [r.path for r in (a, b, c)] == ["x/a.png", "b.png", "c.png"]
    assert b.boards == ()
    assert len(b.corners) == 0
    same_board(a.boards[0], whole)
    if holes.size == size:
        same_board(c.boards[0], holes)
    assert a.boards[0].image_size == (a.width, a.height) == SIZE
    assert sorted(map(tuple, a.corners.xy)) == sorted(map(tuple, whole.xy))
    assert a.boards[0].orientation == ("ambiguous_90" if cols == rows else "ambiguous_180")


@pytest.mark.parametrize("size", [s for s in itertools.product(range(2, 12), repeat=2) if max(s) > 2])
def test_the_size_is_guessed_from_straight_lines(tmp_path, size):
    """Every grid up to 11 × 11 in three pictures in perspective, one of them with holes."""
    holes = tilted(*size, {(1, 0), (0, 1)}, seed=3)
    boards = [tilted(*size, seed=1), tilted(*size, seed=2), holes]
    write_vnl(tmp_path / "c.vnl", [result(f"{k}.png", b) for k, b in enumerate(boards)] + [result("none.png")], size)
    back = read_vnl_boards(tmp_path / "c.vnl", image_size=SIZE)
    same_board(back[0].boards[0], boards[0])
    assert back[3].boards == ()


def test_a_size_that_cannot_be_told(tmp_path):
    write_vnl(tmp_path / "c.vnl", [result("a.png", tilted(2, 2))], (2, 2))
    with pytest.raises(FormatError, match="can't be told from its corners; give columns"):
        read_vnl_boards(tmp_path / "c.vnl", image_size=SIZE)
    assert read_vnl_boards(tmp_path / "c.vnl", (2, 2), SIZE)[0].boards[0].complete
    rng = np.random.default_rng(0)
    (tmp_path / "d.vnl").write_text("".join(f"a.png {x:.3f} {y:.3f} 0\n" for x, y in rng.uniform(0, 400, (24, 2))))
    with pytest.raises(FormatError, match="can't be told"):
        read_vnl_boards(tmp_path / "d.vnl", image_size=SIZE)


@pytest.mark.parametrize("size", [(4, 3), (13, 1), (3, 3)])
def test_a_wrong_size(tmp_path, size):
    write_vnl(tmp_path / "c.vnl", [result("a.png", tilted(5, 4))], (5, 4))
    with pytest.raises(FormatError, match=r"a\.png has 20 rows, but the grid"):
        read_vnl_boards(tmp_path / "c.vnl", size, SIZE)


@pytest.mark.parametrize("size", [(9, 6), (10, 7), (4, 3)])
def test_columns_and_rows_may_be_given_the_other_way_round(tmp_path, size):
    one = result("a.png", tilted(*size))
    write_vnl(tmp_path / "c.vnl", [one], size)
    (found,) = read_vnl_boards(tmp_path / "c.vnl", size[::-1], SIZE)
    same_board(found.boards[0], one.boards[0])


def test_a_size_whose_lines_are_zigzags_is_refused(tmp_path):
    write_vnl(tmp_path / "c.vnl", [result("a.png", tilted(9, 6))], (9, 6))
    with pytest.raises(FormatError, match="18×3 corners are zigzags; give"):
        read_vnl_boards(tmp_path / "c.vnl", (18, 3), SIZE)


@pytest.mark.parametrize(("size", "seen"), [((6, 4), (3, 2)), ((10, 7), (3, 2)), ((9, 6), (4, 1)), ((8, 6), (5, 2))])
@pytest.mark.parametrize("seed", range(4))
def test_few_corners_do_not_refute_a_given_size(tmp_path, size, seen, seed):
    hidden = {(i, j) for i in range(size[0]) for j in range(size[1]) if i >= seen[0] or j >= seen[1]}
    board = tilted(*size, hidden - {(size[0] - 1, size[1] - 1)}, seed=seed)
    write_vnl(tmp_path / "c.vnl", [result("a.png", board)], size)
    lines = [t for t in (tmp_path / "c.vnl").read_text().splitlines() if t.startswith("a.png")]
    last = "a.png - - -" if seen[1] > 1 else lines[-1]
    (tmp_path / "c.vnl").write_text("\n".join([*lines[:-1], last]) + "\n")
    (found,) = read_vnl_boards(tmp_path / "c.vnl", size, SIZE)[0].boards
    assert {tuple(c) for c in found.ij.tolist()} >= {(i, j) for i in range(seen[0]) for j in range(seen[1])}


def test_corners_outside_of_the_picture_are_refused(tmp_path):
    write_vnl(tmp_path / "c.vnl", [result("a.png", tilted(9, 6))], (9, 6))
    assert read_vnl_boards(tmp_path / "c.vnl", None, SIZE)
    with pytest.raises(FormatError, match=r"a\.png has a corner at .*, outside of a picture of 320×240 px"):
        read_vnl_boards(tmp_path / "c.vnl", None, (320, 240))


def test_rows_that_differ_between_images(tmp_path):
    lines = [f"{name} {x} {y} 0\n" for name, n in (("a.png", 4), ("b.png", 3)) for y in range(n) for x in range(3)]
    (tmp_path / "c.vnl").write_text("".join(lines))
    with pytest.raises(FormatError, match="can't be told"):
        read_vnl_boards(tmp_path / "c.vnl", image_size=SIZE)
    with pytest.raises(FormatError, match=r"b\.png has 9 rows, but the grid 3×4 has 12"):
        read_vnl_boards(tmp_path / "c.vnl", (3, 4), SIZE)


def grid_lines(name, xs, ys):
    return "".join(f"{name} {x} {y} 0\n" for y in ys for x in xs)


def test_mirrored_labels(tmp_path):
    """In every image: rows are counted from the other end. In some only: refused."""
    xs, ys = [50, 40, 30, 20, 10], [10, 20, 30]
    path = tmp_path / "c.vnl"
    path.write_text(grid_lines("a.png", xs, ys) + grid_lines("b.png", xs, ys))
    for image in read_vnl_boards(path, image_size=SIZE):
        [board] = image.boards
        grid = board.grid()
        assert grid[0, 0].tolist() == [50, 30]
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        assert right[0] * down[1] - right[1] * down[0] > 0
    path.write_text(grid_lines("a.png", xs[::-1], ys) + grid_lines("b.png", xs, ys))
    with pytest.raises(FormatError, match=r"the labels of b\.png are mirrored"):
        read_vnl_boards(path, image_size=SIZE)


def test_levels_and_missing_corners(tmp_path):
    """A coarse level is less sure; a negative level or position is no corner, as for mrcal,
    but half a pixel out is one."""
    text = "# filename x y level\n" + grid_lines("a.png", range(0, 40, 10), range(0, 30, 10))
    text = text.replace("a.png 0 0 0", "a.png -0.25 0 0").replace("a.png 10 10 0", "a.png 10 10 1")
    text = text.replace("a.png 20 10 0", "a.png 20 10 -1").replace("a.png 30 20 0", "a.png -1 -1 0")
    (tmp_path / "c.vnl").write_text(text)
    [image] = read_vnl_boards(tmp_path / "c.vnl", (4, 3), SIZE)
    [board] = image.boards
    assert len(board) == len(image.corners) == 10
    status = {tuple(k): s for k, s in zip(board.ij.tolist(), board.status, strict=True)}
    assert {k for k, s in status.items() if s == Status.LOW_CONFIDENCE} == {(1, 1)}
    assert set(status.values()) == {Status.REFINED, Status.LOW_CONFIDENCE}
    assert (2, 1) not in status
    assert (3, 2) not in status
    assert board.grid()[0, 0].tolist() == [-0.25, 0]


def test_labels_start_at_the_part_that_was_seen(tmp_path):
    text = "".join(
        f"a.png {10 * i if i else '-'} {10 * j if i else '-'} {0 if i else '-'}\n" for j in range(3) for i in range(4)
    )
    (tmp_path / "c.vnl").write_text(text)
    [board] = read_vnl_boards(tmp_path / "c.vnl", (4, 3), SIZE)[0].boards
    assert board.size == (3, 3)
    assert board.ij.min(axis=0).tolist() == [0, 0]


def test_sizes_come_from_the_pictures(tmp_path, monkeypatch):
    """From the folder of the file, or from here."""
    (tmp_path / "shots").mkdir()
    write_image(tmp_path / "shots" / "a.png", np.zeros((50, 70), np.uint8))
    path = tmp_path / "shots" / "c.vnl"
    path.write_text(grid_lines("a.png", range(0, 40, 10), range(0, 30, 10)) + "b.png - - -\n")
    with pytest.raises(FormatError, match=r"b\.png.*or give the image size"):
        read_vnl_boards(path)
    write_image(tmp_path / "b.png", np.zeros((20, 30), np.uint8))
    monkeypatch.chdir(tmp_path)
    assert [(r.width, r.height) for r in read_vnl_boards(path)] == [(70, 50), (30, 20)]
    assert {(r.width, r.height) for r in read_vnl_boards(path, image_size=(99, 90))} == {(99, 90)}


def test_files_without_boards(tmp_path):
    (tmp_path / "c.vnl").write_text("# filename x y level\na.png - - -\nb.png - -\n")
    assert [r.boards for r in read_vnl_boards(tmp_path / "c.vnl", image_size=SIZE)] == [(), ()]
    (tmp_path / "c.vnl").write_text("")
    assert read_vnl_boards(tmp_path / "c.vnl") == []
    (tmp_path / "c.vnl").write_text("a.png 1\n")
    with pytest.raises(FormatError, match="line 1 must be"):
        read_vnl_boards(tmp_path / "c.vnl")


def part(target, columns, rows, first=(0, 0), seed=0):
    """`columns` × `rows` corners of a coded target, from the place `first` on."""
    board = tilted(columns, rows, seed=seed)
    ij = board.ij + first
    return replace(board, ij=ij, target=target, ids=target.ids(ij))


def places(path, size):
    """{label: position} of each image of a file with a grid of `size`."""
    tables = {name: rows[:, :2] for name, rows in read_vnl(path).items()}
    return {
        name: {(k % size[0], k // size[0]): tuple(xy) for k, xy in enumerate(rows) if np.isfinite(xy[0])}
        for name, rows in tables.items()
    }


CHARUCO = Charuco(8, 6, "DICT_4X4_50", 0.75)


@pytest.mark.parametrize("size", [None, (7, 5)])
def test_parts_of_a_charuco_board_stand_at_their_places(tmp_path, size):
    whole, corner = part(CHARUCO, 7, 5, seed=1), part(CHARUCO, 4, 3, (3, 2), seed=2)
    upper = part(replace(CHARUCO, rows=None, dictionary="DICT_4X4_100"), 5, 3, (1, 0), seed=3)
    images = [result("a", whole), result("b", corner), result("c", upper), result("d", tilted(7, 5)), result("e")]
    assert write_vnl(tmp_path / "c.vnl", images, size) == (7, 5)
    found = places(tmp_path / "c.vnl", (7, 5))
    for name, board in (("a", whole), ("b", corner), ("c", upper)):
        assert found[name] == {tuple(ij): tuple(xy) for ij, xy in zip(board.ij.tolist(), board.xy, strict=True)}
    assert found["d"] == found["e"] == {}  # a board without a place


def test_a_given_size_turns_all_parts_alike(tmp_path):
    whole, corner = part(CHARUCO, 7, 5, seed=1), part(CHARUCO, 4, 3, (3, 2), seed=2)
    assert write_vnl(tmp_path / "c.vnl", [result("a", whole), result("b", corner)], (5, 7)) == (5, 7)
    for name, board in zip("ab", (whole, corner), strict=True):
        turned = {(j, 6 - i): tuple(xy) for (i, j), xy in zip(board.ij.tolist(), board.xy, strict=True)}
        assert places(tmp_path / "c.vnl", (5, 7))[name] == turned


def test_where_nobody_saw_the_foot_the_grid_ends_where_corners_do(tmp_path):
    open_end = replace(CHARUCO, rows=None)
    images = [result("a", part(open_end, 7, 3)), result("b", part(open_end, 4, 2, (3, 2)))]
    assert write_vnl(tmp_path / "c.vnl", images) == (7, 4)
    assert min(places(tmp_path / "c.vnl", (7, 4))["b"]) == (3, 2)


def test_parts_of_a_puzzleboard_share_the_box_of_all(tmp_path):
    images = [result("a", part(PuzzleBoard(), 6, 4, (100, 40))), result("b", part(PuzzleBoard(), 5, 5, (103, 38)))]
    assert write_vnl(tmp_path / "c.vnl", images) == (8, 6)
    found = places(tmp_path / "c.vnl", (8, 6))
    assert (min(found["a"]), min(found["b"])) == ((0, 2), (3, 0))


def test_plain_boards_stand_where_they_are_most(tmp_path):
    images = [*(result(f"p{k}", tilted(6, 4, seed=k)) for k in range(3)), result("a", part(CHARUCO, 4, 3))]
    assert write_vnl(tmp_path / "c.vnl", images) == (6, 4)
    assert [len(found) for found in places(tmp_path / "c.vnl", (6, 4)).values()] == [24, 24, 24, 0]


def test_an_aprilgrid_is_no_grid_of_equal_steps(tmp_path):
    target = AprilGrid(3, 2, "tag36h11", 0.3)
    tags = replace(part(target, 6, 4), pattern="aprilgrid")
    with pytest.raises(FormatError, match="AprilGrid aren't even"):
        write_vnl(tmp_path / "c.vnl", [result("a", tags)])
    write_vnl(tmp_path / "c.vnl", [result("a", tags), result("b", tilted(6, 4))])
    assert [len(found) for found in places(tmp_path / "c.vnl", (6, 4)).values()] == [0, 24]

"""Detections as JSON, corners.vnl and CSV: round trips, determinism, refusals, and the examples of docs/formats.md."""

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from json_edit import edit
from rcdn import Detector
from rcdn.errors import RcdnError
from rcdn.io import FormatError, ImageResult, read_detections, read_vnl, write_csv, write_detections, write_vnl
from rcdn.types import Board, Corners, Status

FORMATS = Path(__file__).parents[1] / "docs" / "formats.md"
SIZE = (640, 480)


def board(cols, rows, drop=(), shift=(0.0, 0.0), orientation="unique", dark=None):
    """A board whose corner (i, j) is at (100 + 10 i, 50 + 10 j) + shift."""
    ij = np.array([(i, j) for j in range(rows) for i in range(cols) if (i, j) not in drop])
    n = len(ij)
    xy = ij * 10 + [100, 50] + np.array(shift)
    return Board(xy, ij, SIZE, np.ones(n), np.zeros(n), orientation, origin_dark=dark)


def result(path, *boards):
    return ImageResult(path, *SIZE, Corners(np.zeros((0, 2)), [], []), boards)


def same(a, b, atol=5.1e-5):
    assert (a is None) == (b is None)
    if a is not None:
        assert a.shape == b.shape
        assert a.dtype == b.dtype
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=atol)


def same_results(a, b):
    assert (a.path, a.width, a.height, len(a.boards)) == (b.path, b.width, b.height, len(b.boards))
    for name in ("xy", "response", "status", "axes", "sigma"):
        same(getattr(a.corners, name), getattr(b.corners, name))
    for p, q in zip(a.boards, b.boards, strict=True):
        assert (p.image_size, p.orientation, p.size) == (q.image_size, q.orientation, q.size)
        assert p.origin_dark is q.origin_dark
        for name in ("xy", "ij", "response", "status", "sigma"):
            same(getattr(p, name), getattr(q, name))


# ---- JSON


@st.composite
def results(draw):
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    n = draw(st.integers(0, 5))
    optional = draw(st.booleans())
    corners = Corners(
        rng.uniform(-1, 640, (n, 2)),
        rng.uniform(0, 2, n),
        rng.integers(0, len(Status), n),
        rng.uniform(0, 3.14, (n, 2)) if optional else None,
        rng.exponential(size=n) if optional else None,
    )
    boards = [
        board(
            draw(st.integers(2, 4)),
            draw(st.integers(2, 4)),
            drop={(1, 1)} if optional else (),
            shift=rng.random(2),
            dark=draw(st.sampled_from([None, True, False])),
        )
        for _ in range(draw(st.integers(0, 2)))
    ]
    path = draw(st.text(min_size=1, max_size=8))
    return ImageResult(path, *SIZE, corners, tuple(boards))


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(results(), max_size=3), st.lists(st.tuples(st.text(max_size=5), st.text(max_size=9)), max_size=2))
def test_round_trip(tmp_path, images, errors):
    path = tmp_path / "a.json"
    write_detections(path, images, errors)
    first = path.read_bytes()
    back, failed = read_detections(path)
    assert failed == errors
    for a, b in zip(images, back, strict=True):
        same_results(a, b)
    write_detections(path, back, failed)
    assert path.read_bytes() == first


def test_the_form_that_scorers_read(tmp_path):
    corners = Corners([[1.23456, 2]], [0.5], [Status.SEED])
    write_detections(tmp_path / "a.json", [ImageResult("p/a.png", *SIZE, corners, (board(2, 2),))], [("b.png", "bad")])
    data = json.loads((tmp_path / "a.json").read_text())
    assert list(data) == ["version", "images", "errors"]
    assert data["version"] == 1
    assert data["errors"] == [{"path": "b.png", "error": "bad"}]
    [image] = data["images"]
    assert image["corners"] == {"xy": [[1.2346, 2.0]], "response": [0.5], "status": ["seed"]}
    assert image["boards"][0] == {
        "ij": [[0, 0], [1, 0], [0, 1], [1, 1]],
        "xy": [[100.0, 50.0], [110.0, 50.0], [100.0, 60.0], [110.0, 60.0]],
        "size": [2, 2],
        "complete": True,
        "orientation": "unique",
        "response": [1.0] * 4,
        "status": ["refined"] * 4,
    }


def test_one_image_a_line_no_minus_zero_any_path(tmp_path):
    corners = Corners([[-0.00001, 1]], [1], [0])
    odd = b"caf\xe9.png".decode("utf-8", "surrogateescape")  # a file name that isn't UTF-8
    images = [ImageResult(p, *SIZE, corners, ()) for p in ("a.png", "größe.png", odd)]
    write_detections(tmp_path / "a.json", images)
    text = (tmp_path / "a.json").read_text("ascii")
    assert len(text.splitlines()) == 5
    assert "-0.0" not in text
    assert [i.path for i in read_detections(tmp_path / "a.json")[0]] == ["a.png", "größe.png", odd]


def test_unknown_numbers_are_null(tmp_path):
    corners = Corners([[1, 1], [2, 2]], [np.nan, 1], [0, 0], sigma=[0.1, np.inf])
    write_detections(tmp_path / "a.json", [ImageResult("a", *SIZE, corners, ())])
    back = read_detections(tmp_path / "a.json")[0][0].corners
    np.testing.assert_array_equal(back.response, [np.nan, 1])
    np.testing.assert_array_equal(back.sigma, [0.1, np.nan])


def test_detections_without_a_picture_s_name_are_refused(tmp_path):
    nothing = Detector().detect(np.zeros((80, 100), np.uint8))
    with pytest.raises(RcdnError, match=r"images\[0\] must be an ImageResult\(path, .*, not Detection"):
        write_detections(tmp_path / "a.json", [nothing])


def test_images_may_come_one_by_one(tmp_path):
    images = [result("a.png", board(3, 3)), result("b.png")]
    write_detections(tmp_path / "a.json", images)
    write_detections(tmp_path / "b.json", iter(images))
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()


def test_a_position_must_be_finite_and_a_board_of_its_image(tmp_path):
    bad = ImageResult("a", *SIZE, Corners([[np.nan, 1]], [1], [0]), ())
    with pytest.raises(FormatError, match="not finite"):
        write_detections(tmp_path / "a.json", [bad])
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(RcdnError, match="image_size"):
        ImageResult("a", 10, 10, Corners(np.zeros((0, 2)), [], []), (board(2, 2),))


def test_optional_fields_may_be_missing_and_unknown_ones_there(tmp_path):
    found = {"ij": [[0, 0], [1, 0]], "xy": [[1, 2], [3, 4]], "size": [2, 1], "complete": True, "orientation": "unique"}
    image = {"path": "a", "width": 640, "height": 480, "camera": 7, "corners": {"xy": [[1, 2]]}, "boards": [found]}
    (tmp_path / "a.json").write_text(json.dumps({"version": 1, "images": [image], "errors": [], "by": "x"}))
    [back], _ = read_detections(tmp_path / "a.json")
    assert back.corners.status.tolist() == [Status.REFINED]
    assert np.isnan(back.boards[0].response).all()


BOARD = ("images", 0, "boards", 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("version", value=2), "version must be 1, not 2"),
        (edit("version", value=...), "version must be 1, not None"),
        (edit("images", value={}), "'images' must be a list"),
        (edit("errors", value=...), "'errors' must be a list"),
        (edit("errors", value=[{"path": "a"}]), "'error' must be text"),
        (edit("images", 0, value=3), "images[0] must be an object"),
        (edit("images", 0, "path", value=None), "images[0]: 'path' must be text"),
        (edit("images", 0, "width", value="640"), "'width' must be a whole number"),
        (edit("images", 0, "height", value=True), "'height' must be a whole number"),
        (edit("images", 0, "corners", value=...), "'corners' must be an object"),
        (edit("images", 0, "corners", "xy", value=[[1, 2], [3]]), "'xy' must hold numbers"),
        (edit("images", 0, "corners", "xy", value=[[1, None]]), "'xy' must hold finite numbers"),
        (edit("images", 0, "corners", "xy", value=[[1, 2, 3]]), "Corners.xy must have shape"),
        (edit("images", 0, "corners", "response", value=[1, 2, 3]), "Corners.response has 3 rows"),
        (edit("images", 0, "corners", "status", value=["good"]), "'status' can't be 'good'"),
        (edit("images", 0, "corners", "status", value=[[]]), "'status' can't be []"),
        (edit(*BOARD, value=[]), "boards[0] must be an object"),
        (edit(*BOARD, "ij", 0, value=[0.5, 0]), "'ij' must hold whole numbers"),
        (edit(*BOARD, "ij", 0, value=[1, 0]), "a label twice"),
        (edit(*BOARD, "ij", 0, value=[9, 9]), "must agree with 'ij'"),
        (edit(*BOARD, "complete", value=False), "must agree with 'ij'"),
        (edit(*BOARD, "complete", value=1), "'complete' must be true or false"),
        (edit(*BOARD, "xy", value=[]), "one row a corner"),
        (edit(*BOARD, "ids", value=["one"]), "'ids' must hold numbers"),
        (edit(*BOARD, "orientation", value="upright"), "'orientation' must be one of unique"),
        (edit(*BOARD, "origin_dark", value=1), "'origin_dark' must be true or false"),
    ],
)
def test_wrong_forms(tmp_path, change, words):
    path = tmp_path / "a.json"
    corners = Corners([[1, 2]], [1], [0])
    write_detections(path, [ImageResult("a.png", *SIZE, corners, (board(2, 2),))])
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data))
    with pytest.raises(FormatError) as caught:
        read_detections(path)
    assert str(caught.value).count(str(path)) == 1
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not JSON"),
        (b"[]", "version"),
        (b'{"version": 1', "not JSON"),
        (b'{"version": 1, "images": [NaN]}', "NaN is not a JSON number"),
        (b'{"version": 1, "kind": "calibration"}', "no detections but of the kind 'calibration'"),
        (b"[" * 100_000, "not JSON"),
        (b"\xff\xfe\x00\x01", "not a text file"),
    ],
)
def test_not_json(tmp_path, content, words):
    (tmp_path / "a.json").write_bytes(content)
    with pytest.raises(FormatError, match=re.escape(words)):
        read_detections(tmp_path / "a.json")


def test_files_that_are_not_there(tmp_path):
    for read in (read_detections, read_vnl):
        with pytest.raises(FormatError, match="no such file"):
            read(tmp_path / "none")
        with pytest.raises(FormatError, match="a folder, where a file is needed"):
            read(tmp_path)


# ---- corners.vnl


def grid_of(path, name, cols, rows):
    return read_vnl(path)[name].reshape(rows, cols, 3)


def test_vnl_text(tmp_path):
    path = tmp_path / "c.vnl"
    assert write_vnl(path, [result("a.png", board(3, 2, drop={(1, 1)})), result("b.png")], (3, 2)) == (3, 2)
    assert path.read_text() == (
        "# filename x y level\n"
        "a.png 100.0000 50.0000 0\na.png 110.0000 50.0000 0\na.png 120.0000 50.0000 0\n"
        "a.png 100.0000 60.0000 0\na.png - - -\na.png 120.0000 60.0000 0\n"
        "b.png - - -\n"
    )


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(2, 5), st.integers(2, 5), st.sets(st.tuples(st.integers(0, 4), st.integers(0, 4)), max_size=6))
def test_vnl_round_trip(tmp_path, cols, rows, drop):
    found = board(cols, rows, drop - {(0, 0), (cols - 1, rows - 1)}, shift=(0.25, -0.125))
    write_vnl(tmp_path / "c.vnl", [result("x/a.png", found), result("b.png")], (cols, rows))
    back = read_vnl(tmp_path / "c.vnl")
    assert list(back) == ["x/a.png", "b.png"]
    assert back["b.png"].shape == (0, 3)
    if found.size == (cols, rows):
        np.testing.assert_array_equal(back["x/a.png"].reshape(rows, cols, 3)[..., :2], found.grid())


def test_vnl_size_is_the_usual_one(tmp_path):
    path = tmp_path / "c.vnl"
    upright, turned, other = board(4, 3), board(3, 4), board(5, 4)
    images = [result("a", upright), result("b", turned), result("c", other), result("d", board(5, 4, {(1, 1)}))]
    assert write_vnl(path, images) == (4, 3)
    assert [len(rows) for rows in read_vnl(path).values()] == [12, 12, 0, 0]
    assert write_vnl(path, [result("a", board(2, 2)), result("b", other)]) == (5, 4)
    assert write_vnl(path, [result("a")]) is None
    assert path.read_text() == "# filename x y level\na - - -\n"
    with pytest.raises(FormatError, match="no board is complete"):
        write_vnl(path, [result("a", board(4, 3, {(1, 1)}))])


def test_vnl_takes_the_fullest_board_that_fits(tmp_path):
    boards = [board(3, 3, {(1, 1)}), board(3, 3, shift=(300, 0)), board(5, 5, shift=(0, 200)), board(2, 3)]
    write_vnl(tmp_path / "c.vnl", [result("a", *boards)], (3, 3))
    np.testing.assert_array_equal(grid_of(tmp_path / "c.vnl", "a", 3, 3)[..., :2], boards[1].grid())


def signed_area(grid):
    """Positive if columns × rows turns like x × y."""
    right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    return right[0] * down[1] - right[1] * down[0]


@pytest.mark.parametrize(("cols", "rows"), [(4, 3), (3, 4), (5, 2), (2, 5), (5, 3), (4, 2)])
def test_a_turned_board_keeps_its_hand_and_its_colour(tmp_path, cols, rows):
    found = board(rows, cols)
    write_vnl(tmp_path / "c.vnl", [result("a", found)], (cols, rows))
    grid = grid_of(tmp_path / "c.vnl", "a", cols, rows)[..., :2]
    assert sorted(map(tuple, grid.reshape(-1, 2))) == sorted(map(tuple, found.xy))
    assert np.allclose(np.linalg.norm(np.diff(grid, axis=0), axis=2), 10)
    assert np.allclose(np.linalg.norm(np.diff(grid, axis=1), axis=2), 10)
    assert signed_area(grid) > 0

    def outer_colour(grid):
        """Colour of the square outside the origin; the square whose top-left corner is (x, y) = (100, 50) is 0."""
        x, y = (grid[0, 0] - (grid[1, 1] - grid[0, 0]) / 2 - [100, 50]) // 10
        return (x + y) % 2

    if (cols + rows) % 2:
        assert outer_colour(grid) == outer_colour(found.grid())


@pytest.mark.parametrize("name", ["my photo.png", "größe.png", "#1.png", "", "a\tb.png", "a\nb.png"])
def test_paths_that_mrcal_cannot_read(tmp_path, name):
    with pytest.raises(FormatError, match="rename") as caught:
        write_vnl(tmp_path / "c.vnl", [result(name)])
    assert repr(name) in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_vnl_of_mrgingham(tmp_path):
    text = (
        "## made by hand\n# filename x y level\na.jpg - -\n\nb.jpg 1385.4 1471.7 0\nb.jpg 1483.6 1469.8 1\nb.jpg 3 4\n"
    )
    (tmp_path / "c.vnl").write_text(text)
    back = read_vnl(tmp_path / "c.vnl")
    assert back["a.jpg"].shape == (0, 3)
    np.testing.assert_array_equal(back["b.jpg"], [[1385.4, 1471.7, 0], [1483.6, 1469.8, 1], [3, 4, 0]])


@pytest.mark.parametrize("line", ["a.png 1", "a.png 1 2 3 4", "a.png one 2 0", "a.png"])
def test_bad_vnl(tmp_path, line):
    (tmp_path / "c.vnl").write_text(f"# filename x y level\n{line}\n")
    with pytest.raises(FormatError, match="line 2 must be"):
        read_vnl(tmp_path / "c.vnl")


# ---- the examples of the documentation


def test_documented_examples_are_what_is_written(tmp_path):
    text, vnl, *_ = re.findall(r"^```(?:json)?\n(.*?)^```$", FORMATS.read_text("utf-8"), re.M | re.S)
    (tmp_path / "a.json").write_text(text)
    images, errors = read_detections(tmp_path / "a.json")
    assert len(images) == 2
    assert len(errors) == 1
    write_detections(tmp_path / "b.json", images, errors)
    assert (tmp_path / "b.json").read_text() == text
    write_vnl(tmp_path / "c.vnl", images, (3, 2))
    assert (tmp_path / "c.vnl").read_text() == vnl


# ---- CSV


def test_csv_says_all_of_each_corner_of_a_board(tmp_path):
    plain, dashed = board(3, 2, drop={(1, 1)}), board(2, 2, shift=(0.123456, -70.0))
    known = Board(
        dashed.xy, dashed.ij, SIZE, dashed.response, dashed.status, "unique", sigma=np.array([0.01, np.nan, 0.5, 2.0])
    )
    name = 'a, "b"\udc80.png'
    write_csv(tmp_path / "c.csv", iter([result(name, plain, known), result("none.png")]))
    with (tmp_path / "c.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["picture"] for row in rows] == ['a, "b"\\udc80.png'] * 9
    assert [row["board"] for row in rows] == ["0"] * 5 + ["1"] * 4
    for got, wanted in ((rows[:5], plain), (rows[5:], known)):
        assert [(int(row["i"]), int(row["j"])) for row in got] == list(map(tuple, wanted.ij.tolist()))
        np.testing.assert_allclose([(float(r["x"]), float(r["y"])) for r in got], wanted.xy, rtol=0, atol=5.1e-5)
        assert [row["id"] for row in got] == [""] * len(wanted)
    assert [row["sigma"] for row in rows] == [""] * 5 + ["0.0100", "", "0.5000", "2.0000"]


def test_the_example_of_csv_in_the_documentation(tmp_path):
    blocks = re.findall(r"```(\w*)\n(.*?)```", FORMATS.read_text(), re.DOTALL)
    example, table = (next(text for _, text in blocks if text.startswith(s)) for s in ('{"version"', "picture,"))
    (tmp_path / "d.json").write_text(example)
    write_csv(tmp_path / "c.csv", read_detections(tmp_path / "d.json")[0])
    assert (tmp_path / "c.csv").read_text() == table

"""The comparison of calibrations: known cameras, noise that one puts in, labels in any order,
and answers that are kept."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import ConfigError
from rcdn.geometry import project, rotation
from rcdn.io import write_image
from rcdn.synthetic import BoardSpec, Scene, Sensor, render
from rcdn.types import Camera
from rcdn_lab.calibration import contestants, parse, pictures, protocol, run, sets
from rcdn_lab.calibration.detectors import Answer, Contestant
from rcdn_lab.peers import Grid

SIZE, WIDE = (7, 5), (640, 480)
LENSES = {
    "brown": Camera([[520.0, 0, 330], [0, 515, 236], [0, 0, 1]], [-0.28, 0.09, 0.001, -0.0015, -0.02], WIDE, "brown"),
    "fisheye": Camera([[250.0, 0, 325], [0, 248, 242], [0, 0, 1]], [0.04, -0.015, 0.006, -0.001], WIDE, "fisheye"),
}
IJ = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).reshape(-1, 2)


@pytest.fixture(autouse=True)
def few_splits(monkeypatch):
    """Two instead of five: enough for all that is asked here."""
    monkeypatch.setattr(protocol, "SPLITS", 2)


def shown(camera, seed, views, bend=0.0):
    """(V, M, 2) exact pixels of whole boards; `bend`: how far their middle stands out, squares."""
    rng = np.random.default_rng(seed)
    raised = bend * (1 - (IJ[:, 0] / 3 - 1) ** 2)
    out = []
    while len(out) < views:
        z = rng.uniform(8, 16)
        R = rotation(np.append(rng.uniform(-0.7, 0.7, 2), 0)) @ rotation(np.array([0, 0, rng.uniform(-3, 3)]))
        points = np.column_stack([IJ - [3, 2], raised]) @ R.T + [*rng.uniform(-0.4, 0.4, 2) * z, z]
        xy = project(camera, points)
        if np.isfinite(xy).all() and (xy > 5).all() and (xy < np.array(WIDE) - 6).all():
            out.append(xy)
    return np.array(out)


def task(xy, model="brown", **more):
    return protocol.task_of([(IJ, spots) for spots in xy], WIDE, SIZE, model, **more)


# ---- the protocol


@pytest.mark.parametrize("model", LENSES)
def test_exact_corners_leave_no_error(model):
    exact = task(shown(LENSES[model], 0, 8), model)
    figures = protocol.errors(exact, [exact])
    assert max(figures.fit, figures.cal, figures.pose, figures.folds, figures.camera) < 1e-5


def test_errors_are_those_of_the_noise_that_was_put_in():
    """20 pictures, noise of 0.1 px an axis: a fit leaves √2·σ·√(1 − unknowns ÷ numbers);
    held out it's more than that of poses alone."""
    rng, xy = np.random.default_rng(1), shown(LENSES["brown"], 1, 20)
    figures = protocol.errors(task(xy + rng.normal(0, 0.1, xy.shape)))
    numbers = 2 * len(IJ) * 20
    length = 0.1 * np.sqrt(2)
    assert figures.fit == pytest.approx(length * np.sqrt(1 - (6 * 20 + 9) / numbers), rel=0.06)
    assert figures.cal == pytest.approx(length * np.sqrt(1 - (6 * 10 + 9) / (numbers / 2)), rel=0.06)
    poses_alone = length * np.sqrt(1 - 6 / (2 * len(IJ)))
    assert 0.97 * poses_alone < figures.folds < 1.1 * poses_alone
    assert figures.cal < figures.pose < 1.2 * poses_alone
    assert figures.unsteady >= 1


def test_the_camera_figure_judges_by_the_references_corners():
    """Bad corners make a bad camera; judged by exact corners only the camera's own error is left."""
    rng, xy = np.random.default_rng(2), shown(LENSES["brown"], 2, 12)
    exact, rough = task(xy), task(xy + rng.normal(0, 0.5, xy.shape))
    good, bad = protocol.errors(exact, [exact]).camera, protocol.errors(rough, [exact]).camera
    assert good < 1e-5
    assert 0.02 < bad < protocol.errors(rough).folds / 2


def test_a_shape_is_fitted_if_asked_for():
    xy = shown(LENSES["brown"], 3, 10, bend=0.05)
    flat, bent = protocol.errors(task(xy)), protocol.errors(task(xy, shaped=True))
    assert bent.pose < 1e-3 < 0.1 < flat.pose  # the prior of a shape is wide, but there is one


def test_outliers_are_left_out_and_counted():
    rng, xy = np.random.default_rng(4), shown(LENSES["brown"], 4, 10)
    xy = xy + rng.normal(0, 0.1, xy.shape)
    xy[3, 7] += 9
    xy[5, 20] -= 14
    used = protocol.without_outliers(task(xy)).used.reshape(10, -1)
    assert np.argwhere(~used).tolist() == [[3, 7], [5, 20]]


def test_sigma_weighs_corners():
    """Half of the corners ten times worse: with weights the camera is better than without."""
    rng, xy = np.random.default_rng(5), shown(LENSES["brown"], 5, 12)
    sigma = np.where(rng.random(xy.shape[:2]) < 0.5, 0.05, 0.5)
    plain, exact = task(xy + sigma[..., None] * rng.normal(size=xy.shape)), task(xy)
    better = protocol.weighted(plain, sigma.ravel())
    assert protocol.errors(better, [exact]).camera < 0.5 * protocol.errors(plain, [exact]).camera


@pytest.mark.parametrize("count", [6, 9, 30])
def test_splits_are_whole_and_the_same_each_time(count):
    for (a, b), (c, d) in zip(protocol.halves(count), protocol.halves(count), strict=True):
        assert sorted([*a, *b]) == list(range(count))
        assert abs(len(a) - len(b)) <= 1
        assert (a == c).all()
        assert (b == d).all()
    assert protocol.halves(count)[0][0].tolist() == list(range(0, count, 2))
    assert sorted(np.concatenate(protocol.folds(count))) == list(range(count))


# ---- boards of different detectors


def grid_of(xy, turns=0, mirrored=False, order=None, sigma=None):
    """The same corners as another detector may label them."""
    board = np.rot90(xy.reshape(SIZE[1], SIZE[0], 2), turns)
    board = board[:, ::-1] if mirrored else board
    ij = np.stack(np.meshgrid(np.arange(board.shape[1]), np.arange(board.shape[0])), axis=-1).reshape(-1, 2)
    order = np.arange(len(ij)) if order is None else order
    return Grid(board.reshape(-1, 2)[order], ij[order] + [2, -3], sigma)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_everybody_gets_the_same_labels(turns, mirrored):
    rng, xy = np.random.default_rng(turns), shown(LENSES["brown"], 6, 1)[0]
    near = xy + rng.normal(0, 0.3, xy.shape)
    sigma = np.linspace(0.01, 0.3, len(xy))
    turned = grid_of(near, turns, mirrored, rng.permutation(len(xy)))
    rank = [int(np.argmin(np.linalg.norm(near - spot, axis=1))) for spot in turned.xy]
    turned = Grid(turned.xy, turned.ij, sigma[rank])
    found = pictures.Found(["a"], WIDE, {"one": [(grid_of(xy),)], "two": [(turned,)]}, {})
    same = pictures.common(found, SIZE)
    assert same.index == [0]
    np.testing.assert_array_equal(same.xy["one"][0], xy)
    np.testing.assert_array_equal(same.xy["two"][0], near)
    np.testing.assert_array_equal(same.sigma["two"][0], sigma)
    assert list(same.sigma) == ["two"]


def test_pictures_in_common_need_all_corners_of_all():
    """Missing, in part, of another size, doubled, or one square off: none of these is the same whole board."""
    xy = shown(LENSES["brown"], 7, 1)[0]
    step = xy[1] - xy[0]
    whole = (grid_of(xy),)
    others = [
        (),
        (Grid(xy[:-1], IJ[:-1]),),
        (Grid(xy[:30], IJ[:30]),),
        (Grid(xy, IJ * 2),),
        (Grid(xy),),
        (grid_of(xy + step),),
        whole,
    ]
    many = len(others)
    found = pictures.Found([""] * many, WIDE, {"one": [whole] * many, "two": others, "three": [whole] * many}, {})
    same = pictures.common(found, SIZE)
    assert same.index == [many - 1]
    assert same.disputed == 1


# ---- the table


class Kept(dict):
    """A store in memory."""

    def __init__(self, salt=""):
        super().__init__()
        self.salt = salt

    def key(self, content, *more):
        return "|".join(map(str, (self.salt, content, *more)))

    def put(self, key, value):
        self[key] = value


@pytest.fixture
def folder(tmp_path):
    """Twelve files whose only grey value is their number."""
    for k in range(12):
        write_image(tmp_path / f"left{k:02d}.png", np.full((WIDE[1], WIDE[0]), k, np.uint8))
    return tmp_path


def detector(name, xy, sigma=None, calls=None, **more):
    """A detector that knows its pictures by their grey value."""

    def find(image, size):
        assert image.shape == WIDE[::-1]
        if calls is not None:
            calls.append(int(image[0, 0]))
        spots = xy[int(image[0, 0])]
        return [] if spots is None else [Grid(spots, IJ, None if sigma is None else np.full(len(spots), sigma))]

    return Contestant(name, lambda: find, more.pop("store", Kept(name)), "1", **more)


def test_the_table_counts_and_tells_noise_apart(folder):
    rng, xy = np.random.default_rng(8), shown(LENSES["brown"], 8, 12)
    fine = list(xy + rng.normal(0, 0.05, xy.shape))
    coarse = list(xy + rng.normal(0, 0.3, xy.shape))
    coarse[4] = None
    fine[6] = fine[6].copy()
    fine[6][3] += 8  # a gross error: left out of "all", not of "common"
    ours, peer = detector("auto", fine, 0.05), detector("opencv", coarse)
    rows = run.table(
        folder, [parse("left:left*:7x5:brown")], [ours, peer], {"opencv-sb": "not installed: pip install it"}
    )
    by = {(r["set"], r["on"], r["detector"]): r for r in rows}
    assert list(by) == [
        ("left", "all", "auto"), ("left", "all", "opencv"),
        *(("left", on, name) for on in ("common", "agreed") for name in ("auto", "auto, by sigma", "opencv")),
        ("ALL", "all", "auto"), ("ALL", "all", "opencv"),
        *(("ALL", on, name) for on in ("common", "agreed") for name in ("auto", "auto, by sigma", "opencv")),
        ("-", "-", "opencv-sb"),
    ]  # fmt: skip
    every, alike = by["left", "all", "auto"], by["left", "common", "auto"]
    assert (every["whole"], every["views"], every["corners"], every["left out"]) == (12, 12, 12 * 35 - 1, 1)
    assert by["left", "all", "opencv"]["whole"] == 11
    assert (alike["views"], alike["corners"], alike["left out"]) == (11, 11 * 35, 0)
    assert every["pose"] == pytest.approx(0.05 * np.sqrt(2), rel=0.15)
    assert alike["pose"] > 0.3  # one corner of 385 is 11 px off: 11 ÷ √385 = 0.58
    agreed = {name: by["left", "agreed", name] for name in ("auto", "auto, by sigma", "opencv")}
    assert {(r["corners"], r["left out"]) for r in agreed.values()} == {(11 * 35 - 1, 1)}
    assert agreed["auto"]["pose"] == pytest.approx(0.05 * np.sqrt(2), rel=0.15)
    assert agreed["auto"]["camera"] == pytest.approx(agreed["opencv"]["folds"], rel=0.1)
    assert by["left", "common", "opencv"]["pose"] == pytest.approx(0.3 * np.sqrt(2), rel=0.15)
    assert by["ALL", "common", "opencv"]["pose"] == pytest.approx(by["left", "common", "opencv"]["pose"])
    assert by["-", "-", "opencv-sb"]["note"].startswith("not installed")
    text = run.markdown(rows)
    assert "| left | 12 | 12 (1) | 11 (0) |" in text


def test_who_finds_few_boards_does_not_narrow_the_comparison(folder):
    rng, xy = np.random.default_rng(11), shown(LENSES["brown"], 11, 12)
    fine, rough = (list(xy + rng.normal(0, s, xy.shape)) for s in (0.05, 0.2))
    few = [spots if k < 7 else None for k, spots in enumerate(rough)]
    trio = [detector("auto", fine), detector("opencv", rough), detector("paper", few)]
    rows = run.table(folder, [parse("left:left*:7x5:brown")], trio)
    views = {(r["on"], r["detector"]): r["views"] for r in rows if r["set"] == "left" and r["on"] != "all"}
    assert views == {
        ("common", "auto"): 12, ("common", "opencv"): 12, ("agreed", "auto"): 12, ("agreed", "opencv"): 12,
        ("with paper", "auto"): 7, ("with paper", "paper"): 7,
    }  # fmt: skip
    pose = {r["detector"]: r["pose"] for r in rows if r["on"] == "with paper"}
    assert 2.5 < pose["paper"] / pose["auto"] < 6
    assert [r["detector"] for r in rows if r["set"] == "ALL" and r["on"] == "common"] == ["auto", "opencv"]


def test_answers_are_kept_and_not_mixed(folder):
    xy, calls = list(shown(LENSES["brown"], 9, 12)), []
    cameras, store = parse("left:left*:7x5"), Kept("this version")
    for _ in range(2):
        found = pictures.detect(cameras, folder, [detector("auto", xy, 0.1, calls, store=store)])
    assert sorted(calls) == list(range(12))
    np.testing.assert_array_equal(found.grids["auto"][5][0].xy, xy[5])
    np.testing.assert_array_equal(found.grids["auto"][5][0].sigma, np.full(35, 0.1))
    store.salt = "another version"
    pictures.detect(cameras, folder, [detector("auto", xy, 0.1, calls, store=store)])
    assert len(calls) == 24
    write_image(folder / "left03.png", np.full((WIDE[1], WIDE[0]), 7, np.uint8))  # a copy of left07.png
    pictures.detect(cameras, folder, [detector("auto", xy, 0.1, calls, store=store)])
    assert len(calls) == 24
    sized = detector("auto", xy, 0.1, calls, store=Kept(), sized=True)
    for size in ("7x5", "5x7"):  # a detector that is told the size may find something else
        pictures.detect(parse(f"left:left*:{size}"), folder, [sized])
    assert len(calls) == 24 + 2 * 11


def test_a_detector_that_breaks_down_is_told_and_asked_again(folder):
    def broken(image, size):
        raise RuntimeError("no memory")

    store = Kept()
    it = Contestant("opencv", lambda: broken, store, "1")
    found = pictures.detect(parse("left:left*:7x5"), folder, [it])
    assert found.notes["opencv"] == "broke down on 12 pictures (RuntimeError: no memory)"
    assert not store
    assert isinstance(it.result(folder / "left00.png", "x", SIZE), Answer)


def test_pictures_of_another_size_are_left_out_for_everybody(folder):
    xy = list(shown(LENSES["brown"], 9, 12))
    write_image(folder / "left99.png", np.zeros((WIDE[1], WIDE[0] + 1), np.uint8))

    def find(image, size):
        return [Grid(xy[int(image[0, 0])], IJ)]

    found = pictures.detect(parse("left:left*:7x5"), folder, [Contestant("auto", lambda: find, Kept(), "1")])
    assert len(found.names) == 12
    assert found.notes[""] == "1 pictures of another size left out"


def test_too_few_pictures_have_no_figures(folder):
    xy = [spots if k < 5 else None for k, spots in enumerate(shown(LENSES["brown"], 9, 12))]
    rows = run.table(folder, [parse("left:left*:7x5")], [detector("opencv", xy)])
    alike = next(r for r in rows if r["on"] == "common")
    assert alike["views"] == 5
    assert alike["pose"] is None
    assert alike["note"] == "too few pictures in common"


# ---- names and sets


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("left:left*:7:brown", "COLUMNSxROWS"),
        ("left:left*:7x2", "at least 3×3"),
        ("left:left*:7x5:zoom", "must be one of pinhole, brown, rational, fisheye, not 'zoom'"),
        (":left*:7x5", "write NAME"),
    ],
)
def test_a_wrong_set_says_what_is_wrong(text, message):
    with pytest.raises(ConfigError, match=message):
        parse(text)


def test_sets_by_name():
    assert [s.name for s in sets.chosen(["gopro", "x:y/*:4x3:fisheye"])] == ["gopro", "x"]
    assert sets.chosen([]) == list(sets.SETS)
    assert len({s.name for s in sets.SETS}) == len(sets.SETS)
    with pytest.raises(ConfigError, match="no set is called nowhere"):
        sets.chosen(["nowhere"])
    with pytest.raises(ConfigError, match="two sets are called gopro"):
        sets.chosen(["gopro", "gopro:y/*:4x3"])


def test_detectors_by_name():
    found, _ = contestants(["auto", "paper", "opencv", "auto"], lambda config: config.to_json(), Kept)
    assert [d.name for d in found] == ["auto", "paper", "opencv"]
    assert len({d.store.salt for d in found}) == 3
    assert [d.sized for d in found] == [False, False, True]
    with pytest.raises(ConfigError, match="nothing is called nobody, raw; known: auto"):
        contestants(["raw", "nobody"], str, Kept)


def test_no_pictures_is_an_error(tmp_path):
    with pytest.raises(ConfigError, match=r"no picture matches left\*"):
        parse("left:left*:7x5").files(tmp_path)


def rendered(count):
    """Pictures of one board by a pinhole camera, turned and tilted."""
    rng = np.random.default_rng(10)
    for k in range(count):
        angle = 2 * np.pi * k / count
        R = rotation(np.array([np.cos(angle), np.sin(angle), 0]) * 0.6) @ rotation(np.array([0, 0, rng.uniform(-3, 3)]))
        middle = np.array([*rng.uniform(-1.5, 1.5, 2), 14]) - R @ [3, 2, 0]
        turn = tuple(float(v) for v in cv2.Rodrigues(R)[0].ravel())
        board = BoardSpec(*SIZE, turn, tuple(float(v) for v in middle))
        yield render(
            Scene(320, 240, 300.0, (162.0, 118.0), boards=(board,), sensor=Sensor(noise=2.0), seed=k), samples=2
        )


def test_the_command_runs_from_pictures_to_files(tmp_path):
    """Rendered boards, by our detector and OpenCV's; a second run detects nothing anew."""
    for k, picture in enumerate(rendered(6)):
        write_image(tmp_path / f"view{k}.png", picture)
    command = [
        "evaluate",
        "calibration",
        str(tmp_path),
        "--set",
        "made:view*:7x5:pinhole",
        "--detectors",
        "auto,opencv",
    ]
    command += [
        "--cache",
        str(tmp_path / "cache"),
        "--json",
        str(tmp_path / "t.json"),
        "--markdown",
        str(tmp_path / "t.md"),
    ]
    first = CliRunner().invoke(app, command)
    assert first.exit_code == 0, first.output
    assert "| made | 6 | 6 (" in (tmp_path / "t.md").read_text()
    rows = json.loads((tmp_path / "t.json").read_text())["rows"]
    alike = {r["detector"]: r for r in rows if r["on"] == "common" and r["set"] == "made"}
    assert alike["auto"]["views"] == 6
    assert alike["auto"]["pose"] < 0.05
    kept = {p: p.read_bytes() for p in (tmp_path / "cache").rglob("*.json")}
    assert len(kept) == 12
    assert CliRunner().invoke(app, command).output.splitlines()[:-1] == first.output.splitlines()[:-1]
    assert {p: p.read_bytes() for p in (tmp_path / "cache").rglob("*.json")} == kept

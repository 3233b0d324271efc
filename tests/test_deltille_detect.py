"""Deltilles from the picture to the camera: detector, command line, files, overlays, targets, calibration."""

import contextlib
import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner

import rcdn
from rcdn.cli import app
from rcdn.errors import ConfigError
from rcdn.geometry import project, transform
from rcdn.io import FormatError, ImageResult, read_detections, write_detections
from rcdn.io.cameras import read_camera
from rcdn.report.overlay import draw_overlay
from rcdn.report.target import make_page, to_pdf, to_svg
from rcdn.synthetic import Background, Scene, Sensor, random_scene, render, truth
from rcdn.types import Board, BoardShape, Corners, Deltille, Printed, plane_points
from rcdn.types.target import Charuco
from rcdn_lab.paper.deltille import same_lattice, score, view_scene

CONFIG = rcdn.DetectorConfig(pattern="deltille", threads=1)


def labels(cols=6, rows=5):
    return np.array([(k - j // 2 + (rows - 1) // 2, j) for j in range(rows) for k in range(cols)])


def board(xy, ij, size=(640, 480), pattern="deltille"):
    zero = np.zeros(len(ij))
    turn = "ambiguous_120" if pattern == "deltille" else "unique"
    return Board(xy, ij, size, zero, zero, turn, pattern=pattern)


def flat(pattern="deltille"):
    return board(100 + 30 * plane_points(labels(), pattern), labels(), pattern=pattern)


@pytest.fixture(scope="module")
def picture():
    return render(view_scene(3))


@pytest.fixture(scope="module")
def detector():
    return rcdn.Detector(CONFIG)


def test_points_of_both_patterns():
    assert plane_points(np.array([[2, 3]])).tolist() == [[2, 3]]
    assert plane_points(np.array([[2, 3]]), "deltille") == pytest.approx(np.array([[3.5, 3 * np.sqrt(0.75)]]))
    sides = plane_points(np.array([[0, 0], [1, 0], [0, 1]]), "deltille")
    assert np.linalg.norm(sides - np.roll(sides, 1, axis=0), axis=1) == pytest.approx(1)
    assert (flat().points == plane_points(labels(), "deltille")).all()


def test_a_deltille_is_never_complete_and_is_not_turned():
    full = board(np.random.default_rng(0).random((12, 2)), np.array([(i, j) for j in range(3) for i in range(4)]))
    assert full.size == (4, 3)
    assert not full.complete
    assert full.grid_of((3, 4)) is None
    assert full.grid_of((4, 3)).shape == (3, 4, 2)
    assert replace(full, pattern="checker", orientation="unique").complete


def test_a_rendered_board_is_found_whole(detector, picture):
    got = score(view_scene(3), detector.boards(picture))
    assert got.corners == 90
    assert got.whole == 1
    assert got.gap / got.found < 0.05


def test_large_small_and_colour_pictures(detector):
    """Large pictures are looked at reduced, too, small ones enlarged; there is one board still."""
    scene = view_scene(5)
    image = render(scene)
    big = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    small = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    for view in (big, small, cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)):
        assert [len(b) for b in detector.boards(view)] == [90]


def test_threads_change_nothing(detector, picture):
    other = rcdn.Detector(replace(CONFIG, threads=2)).boards(picture)
    assert [b.xy.tobytes() for b in other] == [b.xy.tobytes() for b in detector.boards(picture)]


def test_neither_pattern_finds_boards_of_the_other(detector, picture):
    assert rcdn.Detector(rcdn.DetectorConfig(threads=1)).boards(picture) == []
    checker = replace(view_scene(3), boards=(replace(view_scene(3).boards[0], pattern="checker"),))
    assert detector.boards(render(checker)) == []


def test_settings_that_do_not_fit_are_refused():
    with pytest.raises(ConfigError, match="squares only"):
        rcdn.DetectorConfig.paper(pattern="deltille")
    with pytest.raises(ConfigError, match="pattern"):
        rcdn.DetectorConfig(pattern="hexagons")
    assert rcdn.DetectorConfig.from_json(CONFIG.to_json()) == CONFIG


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("refine", rcdn.config.Refine("saddle", half=3)),
        ("sharpen", rcdn.config.Sharpen(geometry=False)),
        ("target", Charuco(5, 7, "DICT_4X4_50", 0.75)),
    ],
)
def test_settings_that_triangles_can_not_use_are_refused(name, value):
    with pytest.raises(
        rcdn.errors.ConfigError, match=rf"DetectorConfig.{name} has no meaning for a deltille; leave it out"
    ):
        rcdn.DetectorConfig(pattern="deltille", **{name: value})
    assert getattr(rcdn.DetectorConfig(**{name: value}), name) == value


def test_that_triangles_have_no_second_fit_and_no_codes_may_be_said(detector, picture):
    """And changes nothing."""
    said = rcdn.Detector(replace(CONFIG, sharpen=None, target="plain")).boards(picture)
    assert [b.xy.tobytes() for b in said] == [b.xy.tobytes() for b in detector.boards(picture)]
    assert len(said) == 1


# ---- command line and files


def test_detect_writes_the_pattern_and_the_labels(tmp_path, picture):
    cv2.imwrite(str(tmp_path / "a.png"), picture)
    files = ["--json", str(tmp_path / "a.json"), "--overlay", str(tmp_path / "drawn")]
    done = CliRunner().invoke(app, ["detect", str(tmp_path / "a.png"), "--pattern", "deltille", "-j", "1", *files])
    assert done.exit_code == 0, done.output
    assert "deltille (90 corners)" in done.stdout
    (record,) = json.loads((tmp_path / "a.json").read_text())["images"][0]["boards"]
    assert record["pattern"] == "deltille"
    assert record["orientation"] == "ambiguous_120"
    assert record["complete"] is False
    ((image,), _) = read_detections(tmp_path / "a.json")
    assert image.boards[0].pattern == "deltille"
    assert next((tmp_path / "drawn").iterdir()).stat().st_size > 1000


@pytest.mark.parametrize("option", [["--board", "9x6"], ["--vnl", "x.vnl"], ["--preset", "paper"]])
def test_options_without_a_meaning_for_triangles_are_refused(tmp_path, option, monkeypatch):
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", np.zeros((40, 40), np.uint8))
    done = CliRunner().invoke(app, ["detect", "a.png", "--pattern", "deltille", *option])
    assert done.exit_code != 0
    assert isinstance(done.exception, (ConfigError, SystemExit, typer.Exit))
    assert not Path("x.vnl").exists()


def test_files_keep_the_pattern_and_checkerboards_have_none(tmp_path):
    none = Corners(np.zeros((0, 2)), [], [])
    path = tmp_path / "d.json"
    write_detections(path, [ImageResult("a", 640, 480, none, (flat(), flat("checker")))])
    one, two = json.loads(path.read_text())["images"][0]["boards"]
    assert one["pattern"] == "deltille"
    assert "pattern" not in two
    got = read_detections(path)[0][0].boards
    assert [b.pattern for b in got] == ["deltille", "checker"]
    path.write_text(path.read_text().replace('"pattern": "deltille"', '"pattern": "hexagon"'))
    with pytest.raises(FormatError, match="pattern"):
        read_detections(path)


def test_overlay_draws_all_three_families_of_lines():
    image, bare = np.full((480, 640), 120, np.uint8), Corners(np.zeros((0, 2)), [], [])
    ink = np.abs(draw_overlay(image, bare, [flat()]).astype(int) - draw_overlay(image, bare, [])).sum(axis=2) > 60
    scale = ink.shape[1] / 640
    for a, b in (((3, 1), (4, 1)), ((3, 1), (3, 2)), ((3, 2), (4, 1))):
        x, y = ((flat().xy[[labels().tolist().index(list(k)) for k in (a, b)]].mean(axis=0) + 0.5) * scale).astype(int)
        assert ink[y - 2 : y + 3, x - 2 : x + 3].any()
    i, j = 4, 2
    x, y = ((100 + 30 * plane_points(np.array([i + 1 / 3, j + 1 / 3]), "deltille") + 0.5) * scale).astype(int)
    assert not ink[y - 1 : y + 2, x - 1 : x + 2].any()


# ---- target


def test_the_target_has_the_corners_that_it_says():
    """Its black triangles meet, three in each, in as many points as it has inner corners, at true scale."""
    page = make_page(Printed(Deltille(7, 5), 0.02))
    tips = np.array([t.loops[0] for t in page.shapes]).reshape(-1, 2).round(6)
    points, counts = np.unique(tips, axis=0, return_counts=True)
    inner = points[counts == 3]
    assert len(inner) == 7 * 5
    assert counts.max() == 3
    near = np.sort(np.linalg.norm(inner[:, None] - inner, axis=2), axis=1)[:, 1]
    assert near == pytest.approx(20.0, abs=1e-4)
    sides = [np.linalg.norm(np.subtract(t.loops[0], np.roll(t.loops[0], 1, axis=0)), axis=1) for t in page.shapes]
    assert np.concatenate(sides) == pytest.approx(20.0)
    assert tips.min() >= 10 - 1e-6
    assert (tips.max(axis=0) <= np.array(page.size) - [10, 14]).all()


def test_both_files_hold_the_triangles(tmp_path):
    page = make_page(Printed(Deltille(5, 4), 0.02))
    svg = to_svg(page)
    drawn = [[float(v) for v in re.split("[ ,]", p)] for p in re.findall(r'points="([^"]*)"', svg)]
    assert np.array(drawn) == pytest.approx(np.array([t.loops[0] for t in page.shapes]).reshape(-1, 6), abs=1e-4)
    number = rb"-?[\d.]+"
    paths = re.findall(rb"(%b) (%b) m (%b) (%b) l (%b) (%b) l h" % ((number,) * 6), to_pdf(page))
    flipped = np.array(paths, float).reshape(-1, 3, 2) * [1, -1] + [0, page.size[1]]
    assert flipped == pytest.approx(np.array([t.loops[0] for t in page.shapes]), abs=1e-4)
    done = CliRunner().invoke(
        app, ["board", "--size", "5x4", "--spacing", "0.02", "--pattern", "deltille", "-o", str(tmp_path / "t.pdf")]
    )
    assert done.exit_code == 0, done.output
    assert "triangles" in done.stdout
    with pytest.raises(ConfigError, match="deltille"):
        make_page(Printed(Deltille(12, 9), 0.05))


def test_a_printed_target_is_found(detector):
    sheet = make_page(Printed(Deltille(9, 8), 0.018))
    scale = 4.0
    page = np.full((int(sheet.size[1] * scale), int(sheet.size[0] * scale)), 235, np.uint8)
    for t in sheet.shapes:
        corners = np.array(t.loops[0]) * scale - 0.5
        cv2.fillPoly(page, [np.round(corners * 16).astype(np.int32)], 20, cv2.LINE_AA, 4)
    image = cv2.resize(cv2.GaussianBlur(page, (0, 0), 1.5), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    assert [len(b) for b in detector.boards(image)] == [72]


# ---- calibration


def views(count, noise, pattern="deltille"):
    rng = np.random.default_rng(7)
    camera = view_scene(0).camera
    out, ij = [], labels(9, 8)
    points = np.column_stack([plane_points(ij, pattern) * 0.03, np.zeros(len(ij))])
    while len(out) < count:
        R = cv2.Rodrigues(rng.normal(0, 0.45, 3))[0]
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, [rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05), rng.uniform(0.45, 0.7)]
        T[:3, 3] -= R @ points.mean(axis=0)
        xy = project(camera, transform(rcdn.Pose(T), points))
        if (xy > 5).all() and (xy < [634, 474]).all():
            out.append((board(xy + rng.normal(0, noise, xy.shape), ij, pattern=pattern), T))
    return out, camera


def test_calibration_and_pose_take_labels_as_triangles():
    seen, camera = views(12, 0.02)
    found = rcdn.calibrate([b for b, _ in seen], 0.03, model="brown")
    assert found.camera.K[0, 0] == pytest.approx(camera.K[0, 0], rel=2e-3)
    assert found.rms < 0.05
    got = rcdn.estimate_pose(seen[0][0], camera, 0.03)
    assert got.rms < 0.05
    assert got.T_cam_board == pytest.approx(seen[0][1], abs=1e-3)


def test_labels_taken_as_squares_would_not_do():
    seen, _ = views(12, 0.02)
    wrong = [replace(b, pattern="checker", orientation="unique") for b, _ in seen]
    with contextlib.suppress(rcdn.RcdnError):
        assert rcdn.calibrate(wrong, 0.03, model="brown").rms > 1


def test_squares_and_triangles_are_not_mixed():
    seen, _ = views(6, 0.0)
    other = replace(seen[0][0], pattern="checker", orientation="unique")
    with pytest.raises(ConfigError, match="one kind"):
        rcdn.calibrate([*(b for b, _ in seen), other], 0.03)
    columns, rows = seen[0][0].size
    shape = BoardShape(np.zeros((rows, columns, 3)))
    with pytest.raises(ConfigError, match="shape"):
        rcdn.estimate_pose(seen[0][0], view_scene(0).camera, 0.03, shape=shape)


# ---- pictures


def test_both_real_pictures(shared_data, detector):
    """One shows two boards; the other a fisheye's view with two black covers on one board."""
    folder = shared_data / "deltille-libcbdetect"
    if not folder.is_dir():
        pytest.skip("no pictures of deltilles")
    two = detector.boards(rcdn.read_image(folder / "example_data__e6.png"))
    assert len(two) == 2
    assert min(len(b) for b in two) >= 85
    (one,) = detector.boards(rcdn.read_image(folder / "example_data__e7.png"))
    assert len(one) >= 72
    for found in (*two, one):
        steps = [found.xy[a] - found.xy[b] for a, b in _neighbours(found)]
        assert np.linalg.norm(steps, axis=1).max() < 3 * np.linalg.norm(steps, axis=1).min()


def _neighbours(found):
    at = {tuple(ij): k for k, ij in enumerate(found.ij.tolist())}
    return [(k, at[n]) for (i, j), k in at.items() for n in ((i + 1, j), (i, j + 1), (i - 1, j + 1)) if n in at]


def test_clutter_has_no_deltille(detector):
    for seed in range(4):
        scene = random_scene(np.random.default_rng(seed), size=(320, 240))
        assert detector.boards(render(scene, samples=2)) == []
    noise = np.random.default_rng(1).integers(0, 255, (200, 300)).astype(np.uint8)
    blank = Scene(200, 150, 300.0, (99.5, 74.5), background=Background("plain", 2), sensor=Sensor(noise=3))
    for image in (noise, cv2.GaussianBlur(noise, (0, 0), 2.5), render(blank)):
        assert detector.boards(image) == []


def test_labels_agree_up_to_what_colours_leave():
    ij = labels()
    u, v = ij.T
    third = np.stack([4 - u - v, u + 1], axis=1)
    assert same_lattice(third, ij, swapped=False).all()
    assert not same_lattice(third, ij, swapped=True).all()
    third[3] += 1
    assert same_lattice(third, ij, swapped=False).sum() == len(ij) - 1
    assert truth(view_scene(1))[0].visible.all()


def test_the_command_line_calibrates_and_poses_from_pictures_of_deltilles(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for k in range(8):
        cv2.imwrite(f"{k}.png", render(view_scene(k)))
    done = CliRunner().invoke(
        app, ["calibrate", ".", "--spacing", "0.02", "--pattern", "deltille", "--model", "brown", "--no-cache",
              "--jobs", "1", "-o", "cam.json"]
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    known = view_scene(0).camera.K
    assert np.abs(read_camera(Path("cam.json")).K - known).max() < 3  # px
    posed = CliRunner().invoke(
        app, ["pose", "0.png", "--camera", "cam.json", "--spacing", "0.02", "--pattern", "deltille", "--no-cache"]
    )
    assert posed.exit_code == 0, posed.output
    for wrong in (["--stereo", "."], ["--board", "9x6"]):
        refused = CliRunner().invoke(app, ["calibrate", ".", "--spacing", "0.02", "--pattern", "deltille", *wrong])
        assert refused.exit_code == 2
        assert "squares only" in refused.output

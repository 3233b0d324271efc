"""Pictures without distortion: which part is shown, which pixels they hold, and what `rcdn undistort` writes."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import RcdnError
from rcdn.geometry import project, unproject
from rcdn.geometry.flat_view import flat_camera, largest_rectangle, seen
from rcdn.geometry.resample import undistortion
from rcdn.io import read_camera, read_pixels, write_camera, write_image
from rcdn.io.finding import find
from rcdn.io.marks import mark_of
from rcdn.types import Camera, LensCorrection

SIZE = (160, 120)
K = np.array([[90.0, 0, 84], [0, 92, 57], [0, 0, 1]])
BARREL = Camera(K, np.array([-0.25, 0.06, 0.002, -0.001, 0]), SIZE, "brown")
PINCUSHION = Camera(K, np.array([0.15, 0.02, -0.001, 0.002, 0]), SIZE, "brown")
FISHEYE = Camera(K * [[0.5, 1, 1], [1, 0.5, 1], [1, 1, 1]], np.array([0.02, -0.01, 0.003, -0.001]), SIZE, "fisheye")
PINHOLE = Camera(K, np.zeros(0), SIZE, "pinhole")
BUMPS = LensCorrection(0.01 * np.random.default_rng(3).normal(size=(6, 7, 2)), np.array([1.0, 0.8]))
SPLINED = Camera(BARREL.K, BARREL.distortion, SIZE, "brown", BUMPS)
CAMERAS = [BARREL, PINCUSHION, FISHEYE, PINHOLE, SPLINED]
NAMES = ["barrel", "pincushion", "fisheye", "pinhole", "splined"]


def grid(size):
    """All pixels (H, W, 2)."""
    return np.stack(np.meshgrid(np.arange(size[0], dtype=float), np.arange(size[1], dtype=float)), axis=-1)


def scene(camera):
    """(H, W) in 0..1: what the camera sees of a scene that is smooth in the ray's angles."""
    ray = unproject(camera, grid(camera.image_size))
    across, down = (np.arctan2(ray[..., k], ray[..., 2]) for k in (0, 1))
    return 0.5 + 0.25 * np.sin(5 * across) + 0.2 * np.cos(4 * down + across)


# ---- the view


@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_balance_0_has_no_empty_pixel_and_1_has_all_that_was_seen(camera):
    inner, outer = flat_camera(camera, 0), flat_camera(camera, 1)
    assert seen(camera, unproject(inner, grid(SIZE))).all()
    rays = unproject(camera, grid(SIZE))
    near = np.hypot(rays[..., 0], rays[..., 1]) < np.tan(np.radians(54)) * rays[..., 2]
    at = project(outer, rays[near])
    assert (at >= -0.51).all()
    assert (at <= np.array(SIZE) - 0.49).all()
    between = flat_camera(camera, 0.5)
    assert outer.K[0, 0] - 1e-9 <= between.K[0, 0] <= inner.K[0, 0] + 1e-9


def test_the_inner_view_is_as_wide_as_it_can_be():
    inner = flat_camera(PINCUSHION, 0)
    wider = inner.K.copy()
    wider[[0, 1], [0, 1]] *= 0.99
    rays = unproject(Camera(wider, np.zeros(0), SIZE, "pinhole"), grid(SIZE))
    assert not seen(PINCUSHION, rays).all()


@pytest.mark.parametrize("balance", [-0.1, 1.1, np.nan])
def test_a_balance_out_of_range_is_refused(balance):
    with pytest.raises(RcdnError, match="balance must be within 0"):
        flat_camera(BARREL, balance)


def test_the_largest_rectangle_holds_nothing_else_and_is_as_large_as_by_trying_all():
    rng = np.random.default_rng(5)
    for _ in range(20):
        mask = rng.random((9, 11)) < 0.8
        left, top, right, bottom = largest_rectangle(mask)
        assert mask[top:bottom, left:right].all()
        spans = [
            [(a, b) for a, b in product(range(side + 1), repeat=2) if a < b] for side in (mask.shape[1], mask.shape[0])
        ]
        best = max((r - x) * (b - t) for x, r in spans[0] for t, b in spans[1] if mask[t:b, x:r].all())
        assert (right - left) * (bottom - top) == best
    assert largest_rectangle(np.zeros((5, 6), bool)) == (0, 0, 0, 0)


def test_the_rectangle_of_a_large_mask_reaches_its_ends():
    mask = np.zeros((700, 1000), bool)
    mask[33:650, 41:977] = True
    assert largest_rectangle(mask) == (41, 33, 977, 650)


# ---- the pixels


@pytest.mark.parametrize(("balance", "scale", "crop"), [(0, 1, False), (1, 1, False), (1, 1, True), (0, 2, False)])
@pytest.mark.parametrize("camera", CAMERAS, ids=NAMES)
def test_pixels_are_what_the_new_camera_sees(camera, balance, scale, crop):
    make = undistortion(camera, balance, scale, crop)
    out = make(scene(camera).astype(np.float32))
    wanted = scene(make.flat)
    there = ~make.empty
    inside = cv2.erode(there.astype(np.uint8), np.ones((5, 5))).astype(bool)
    assert np.abs(out - wanted)[inside].max() < 0.01
    assert not out[make.empty].any()
    assert out.shape == make.flat.image_size[::-1]
    if balance == 0 or crop:
        assert there.all()


def test_smaller_pictures_are_means_over_areas_of_what_the_new_camera_sees():
    make = undistortion(BARREL, 0, 0.25)
    assert make.flat.image_size == (40, 30)
    assert np.abs(make(scene(BARREL).astype(np.float32)) - scene(make.flat)).max() < 0.01
    noise = np.random.default_rng(1).integers(0, 256, SIZE[::-1]).astype(np.uint8)
    assert make(noise).std() < 0.45 * undistortion(BARREL)(noise).std()  # one pixel in sixteen would keep the noise


def test_another_size_and_a_scale_of_nothing_are_refused():
    with pytest.raises(RcdnError, match="81×60 px, but the camera was calibrated at 160×120 px"):
        undistortion(BARREL)(np.zeros((60, 81), np.uint8))
    with pytest.raises(RcdnError, match="scale must be above 0"):
        undistortion(BARREL, scale=0)
    with pytest.raises(RcdnError, match="too large; lower the scale"):
        undistortion(BARREL, scale=150)
    with pytest.raises(RcdnError, match="32766 px at most"):
        undistortion(BARREL, scale=300)


# ---- the command


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run `rcdn undistort ARGUMENTS` in a temporary folder with a camera file."""
    monkeypatch.chdir(tmp_path)
    write_camera("camera.yaml", BARREL)

    def go(*arguments):
        return CliRunner().invoke(app, ["undistort", *map(str, arguments)], catch_exceptions=False)

    return go


def picture(path, dtype=np.uint8, channels=3):
    """Write a picture of the scene that BARREL sees; returns it."""
    many = {np.uint8: 255, np.uint16: 65535, np.float32: 1}[dtype]
    grey = (scene(BARREL) * many).astype(dtype)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    pixels = grey if channels == 1 else np.stack([grey, grey // 2, grey // 3], axis=-1)
    write_image(path, pixels)
    return pixels


def test_pictures_keep_names_folders_depth_and_channels(run):
    made = {
        "in/a.png": picture("in/a.png"),
        "in/deep/b.png": picture("in/deep/b.png", np.uint16, 1),
        "in/deep/c.tif": picture("in/deep/c.tif", np.uint16),
        "in/d.tiff": picture("in/d.tiff", np.float32, 1),
        "in/e.pgm": picture("in/e.pgm", np.uint8, 1),
    }
    picture("in/f.JPG")
    result = run("camera.yaml", "in", "--out", "out")
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith("6 pictures of 160×120 px")
    make = undistortion(BARREL)
    for name, pixels in made.items():
        assert np.array_equal(read_pixels(name.replace("in/", "out/")), make(pixels)), name
    assert read_pixels("out/f.JPG").shape == (120, 160, 3)
    flat = read_camera("out/undistorted-camera.yaml")
    assert flat.model == "pinhole"
    assert np.allclose(flat.K, make.flat.K)


def test_bad_pictures_and_wrong_sizes_are_told_and_the_others_written(run):
    picture("in/a.png")
    Path("in/b.png").write_bytes(b"no picture")
    write_image("in/c.png", np.zeros((60, 81), np.uint8))
    picture("in/d.png")
    result = run("camera.yaml", "in", "missing.png", "--out", "out")
    assert result.exit_code == 1
    assert len(result.stderr.splitlines()) == 3
    assert f"{Path('in/c.png')}: the picture has 81×60 px, but the camera was calibrated at 160×120 px" in result.stderr
    assert sorted(p.name for p in Path("out").iterdir()) == ["a.png", "d.png", "undistorted-camera.yaml"]


def test_frames_of_videos_become_pictures(run):
    video = cv2.VideoWriter("clip.avi", cv2.VideoWriter_fourcc(*"MJPG"), 10, SIZE)
    for _ in range(3):
        video.write(np.full((120, 160, 3), 128, np.uint8))
    video.release()
    assert run("camera.yaml", "clip.avi", "--out", "out").exit_code == 0
    assert sorted(p.name for p in Path("out/clip.avi").iterdir()) == ["000000.png", "000001.png", "000002.png"]


def test_that_the_camera_of_earlier_pictures_is_replaced_is_said(run):
    """A file of somebody else's with its name isn't; the same camera again is no other one."""
    picture("in/a.png")
    for _ in range(2):
        assert "another camera" not in run("camera.yaml", "in", "--out", "out").stderr
    before = Path("out/undistorted-camera.yaml").read_bytes()
    result = run("camera.yaml", "in", "--out", "out", "--scale", "0.5")
    assert result.exit_code == 0
    assert "held another camera" in result.stderr
    Path("out/undistorted-camera.yaml").write_text("mine")
    assert run("camera.yaml", "in", "--out", "out").exit_code == 2
    assert Path("out/undistorted-camera.yaml").read_text() == "mine"
    assert run("camera.yaml", "in", "--out", "out", "--overwrite").exit_code == 0
    assert Path("out/undistorted-camera.yaml").read_bytes() == before


def test_the_camera_of_other_pictures_stays_if_none_is_written(run):
    picture("in/a.png")
    assert run("camera.yaml", "in", "--out", "out").exit_code == 0
    before = Path("out/undistorted-camera.yaml").read_bytes()
    write_camera("large.yaml", Camera(BARREL.K, BARREL.distortion, (1280, 960), BARREL.model))
    result = run("large.yaml", "in", "--out", "out")
    assert result.exit_code == 1
    assert "0 pictures" in result.stdout
    assert "camera" not in result.stdout
    assert "held another camera" not in result.stderr
    assert Path("out/undistorted-camera.yaml").read_bytes() == before


def test_nothing_of_others_is_written_over_and_a_second_run_replaces_the_first(run):
    picture("in/a.png")
    picture("in/b.jpg")
    picture("out/a.png")
    before = Path("out/a.png").read_bytes()
    result = run("camera.yaml", "in", "--out", "out")
    assert result.exit_code == 1
    assert f"{Path('out/a.png')}: is there already, and not marked as written by rcdn" in result.stderr
    assert Path("out/a.png").read_bytes() == before
    assert mark_of("out/b.jpg") == "rcdn undistorted"
    assert run("camera.yaml", "in", "--out", "out", "--overwrite").exit_code == 0
    assert mark_of("out/a.png") == "rcdn undistorted"
    assert run("camera.yaml", "in", "--out", "out", "--balance", "1").exit_code == 0


@pytest.mark.parametrize("ending", [".tif", ".webp", ".bmp", ".ppm", ".jp2"])
def test_undistorted_pictures_of_every_format_are_known_again(run, ending):
    """They are no originals beside the originals, and the next run replaces them; nobody else's are replaced."""
    for name in ("a", "b"):
        picture(f"in/{name}{ending}")
    for _ in range(2):
        result = run("camera.yaml", "in", "--out", "in/flat")
        assert (result.exit_code, result.stdout[:11]) == (0, "2 pictures ")
    assert [path.name for path in find(["in"]).files] == [f"a{ending}", f"b{ending}"]
    assert len(find(["in"]).own) == 2
    assert len(find(["in/flat"]).files) == 2  # nothing else is there
    mine = Path(f"in/flat/a{ending}")
    picture(mine)
    before = mine.read_bytes()
    assert run("camera.yaml", "in", "--out", "in/flat").exit_code == 1
    assert mine.read_bytes() == before


def test_inputs_are_safe_in_whatever_way_the_folder_is_named(run):
    picture("in/a.png")
    Path("link").symlink_to("in")
    before = Path("in/a.png").read_bytes()
    for out in ("in", "link", "."):
        result = run("camera.yaml", "in", "--out", out, "--overwrite")
        assert result.exit_code == 2, out
        assert "inputs" in result.stderr
    assert Path("in/a.png").read_bytes() == before
    assert run("camera.yaml", "in/a.png", "--out", "in/flat").exit_code == 0  # beside them is no harm
    again = run("camera.yaml", "in", "--out", "in/flat")
    assert again.stdout.startswith("1 picture of ")


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another thing there")
def test_ctrl_c_leaves_whole_pictures_and_one_line(run, tmp_path):
    data = cv2.imencode(".png", picture("in/0.png"))[1].tobytes()
    for k in range(1, 3000):
        Path(f"in/{k}.png").write_bytes(data)
    command = [sys.executable, "-m", "rcdn", "undistort", "camera.yaml", "in", "--out", "out"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        end = time.monotonic() + 60
        while not Path("out/0.png").exists() and process.poll() is None and time.monotonic() < end:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out) == (130, "")
    assert re.fullmatch(r"error: stopped by Ctrl-C; \d+ pictures? of 160×120 px, .*\n", err)
    made = sorted(p for p in Path("out").iterdir() if p.suffix == ".png")
    assert 0 < len(made) < 3000
    wanted = read_pixels(made[0])
    assert all(np.array_equal(read_pixels(p), wanted) for p in made)
    assert not [p for p in Path("out").iterdir() if p.name.startswith(".")]


def test_wrong_use_is_2(run):
    picture("in/a.png")
    for more in (["--balance", "2"], ["--scale", "0"], ["--camera-name", "left"]):
        assert run("camera.yaml", "in", "--out", "out", *more).exit_code in (1, 2)
        assert not Path("out").exists()
    assert run("camera.yaml", "empty", "--out", "out").exit_code == 2
    assert run("in/a.png", "in", "--out", "out").exit_code == 1


@pytest.mark.parametrize(
    ("dtype", "as_type"), [("float16", "float32"), (">f2", "float32"), (">u2", "uint16"), (">f4", "float32")]
)
def test_depths_that_opencv_does_not_resample_are_taken_as_those_that_it_does(dtype, as_type):
    image = np.random.default_rng(0).integers(0, 200, SIZE[::-1]).astype(dtype)
    assert np.array_equal(BARREL.undistort(image), BARREL.undistort(image.astype(as_type)))

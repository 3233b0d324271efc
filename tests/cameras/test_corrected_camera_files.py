"""Files of cameras with a smooth correction: ours exactly, mrcal's as its splined lens,
the others as their best fit, and maps."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from camera_files import mrcal, opencv_pixels

from rcdn.errors import FormatError, RcdnError
from rcdn.geometry import project, rotation, stereographic, unproject, zero_correction
from rcdn.geometry.fit_lens import best_coefficients, nearest_camera
from rcdn.io import (
    StereoCameras,
    camera_format,
    lens_fit,
    read_camera,
    read_stereo,
    write_camera,
    write_maps,
    write_stereo,
    write_stereo_maps,
)
from rcdn.io.cameras.rig import Rectification
from rcdn.types import Camera

SIZE = (640, 480)
K = np.array([[410.0, 0, 322], [0, 405, 243], [0, 0, 1]])
BASES = {
    "pinhole": ("pinhole", []),
    "brown": ("brown", [-0.2, 0.04, 0.002, -0.001, 0.001]),
    "rational": ("rational", [0.4, -0.05, 0.002, -0.003, 0.01, 0.75, 0.05, -0.002]),
    "fisheye": ("fisheye", [0.03, -0.008, 0.002, -0.0005]),
}


def rippled(base="brown", height=1.0, columns=12):
    """A camera with ripples of about `height` px."""
    model, distortion = BASES[base]
    camera = Camera(K, np.array(distortion, float), SIZE, model)
    grid = zero_correction(camera, columns)
    rows, columns, _ = grid.control.shape
    y, x = np.mgrid[:rows, :columns]
    net = height / 410 * np.stack([np.sin(1.1 * x + 0.4 * y), np.cos(0.9 * y - 0.3 * x)], axis=-1)
    return replace(camera, correction=grid.with_control(net))


def pixels(along=40):
    x, y = (np.linspace(-0.5, n - 0.5, along) for n in SIZE)
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def gap(found, camera):
    """Distances (N,) of where both cameras see the rays of the frame, px."""
    rays = unproject(camera, pixels())
    return np.linalg.norm(project(found, rays) - pixels(), axis=1)


@pytest.mark.parametrize("base", BASES)
def test_our_json_keeps_every_digit(tmp_path, base):
    path = tmp_path / "camera.json"
    camera = rippled(base)
    assert write_camera(path, camera) is None
    back = read_camera(path)
    np.testing.assert_array_equal(back.parameters, camera.parameters)
    np.testing.assert_array_equal(back.correction.extent, camera.correction.extent)
    first = path.read_bytes()
    write_camera(path, back)
    assert path.read_bytes() == first


def test_a_broken_correction_is_named(tmp_path):
    path = tmp_path / "camera.json"
    write_camera(path, rippled())
    data = json.loads(path.read_text())
    for broken in (
        [1, 2],
        {"extent": [1, 1]},
        {"extent": [1, 1], "control": [[[0, 0]]]},
        {"extent": [1, 0], "control": []},
    ):
        data["camera"]["correction"] = broken
        path.write_text(json.dumps(data))
        with pytest.raises(FormatError, match=r"correction|control"):
            read_camera(path)


@pytest.mark.parametrize("base", BASES)
def test_mrcal_sees_the_same_pixels(tmp_path, base):
    """Our camera as mrcal's splined lens, projected and unprojected by mrcal."""
    path, camera = tmp_path / "a.cameramodel", rippled(base)
    fit = write_camera(path, camera)
    assert fit.largest < 0.005
    assert f"{fit.largest:.4f} px at most" in path.read_text()
    rays = unproject(camera, pixels(25))
    seen, back, size = mrcal(
        "m = mrcal.cameramodel(a[0])\n"
        "p, q = (np.array(json.loads(s)) for s in a[1:])\n"
        "v = mrcal.unproject(q, *m.intrinsics(), normalize=True)\n"
        "print(json.dumps([mrcal.project(p, *m.intrinsics()).tolist(), v.tolist(), m.imagersize().tolist()]))",
        path,
        json.dumps(rays.tolist()),
        json.dumps(pixels(25).tolist()),
    )
    assert size == list(SIZE)
    assert np.linalg.norm(np.array(seen) - pixels(25), axis=1).max() < 0.005
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    assert np.abs(np.array(back) - rays).max() < 0.005 / 400


@pytest.mark.parametrize("base", BASES)
def test_the_splined_file_is_read_back(tmp_path, base):
    write_camera(tmp_path / "a.cameramodel", rippled(base))
    assert gap(read_camera(tmp_path / "a.cameramodel"), rippled(base)).max() < 0.006


def test_a_splined_lens_that_mrcal_made_is_read(tmp_path):
    """Wide, coarse and rough: in the domain of the spline both see the same."""
    path = tmp_path / "a.cameramodel"
    u, seen = mrcal(
        "name = 'LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=11_Ny=9_fov_x_deg=150'\n"
        "rng = np.random.default_rng(0)\n"
        "numbers = np.concatenate([[300, 305, 320, 240], 0.02 * rng.normal(size=198)])\n"
        "m = mrcal.cameramodel(intrinsics=(name, numbers), imagersize=np.array((640, 480)))\n"
        "m.write(a[0])\n"
        "u = rng.uniform(-1, 1, (2000, 2)) * 2 * np.tan(np.radians(150) / 4) * np.array((1, 6 / 8))\n"
        "p = mrcal.unproject_stereographic(u)\n"
        "print(json.dumps([u.tolist(), mrcal.project(p, name, numbers).tolist()]))",
        path,
    )
    camera, u = read_camera(path), np.array(u)
    p = np.column_stack([u, 1 - (u**2).sum(axis=1) / 4])
    assert stereographic(p) == pytest.approx(u)
    assert np.abs(project(camera, p) - seen).max() < 0.002
    again = write_camera(tmp_path / "b.cameramodel", camera)
    assert again.largest < 0.01


def test_a_lens_that_sees_behind_itself_is_written_to_120_degrees(tmp_path):
    base = Camera([[230, 0, 640], [0, 230, 480], [0, 0, 1]], [0.01, -0.002, 0, 0], (1280, 960), "fisheye")
    camera = replace(base, correction=zero_correction(base, 10))
    fit = write_camera(tmp_path / "a.cameramodel", camera)
    assert 230 <= fit.held.fov <= 240
    assert fit.largest < 0.005
    grid = np.stack(np.meshgrid(np.linspace(0, 1279, 40), np.linspace(0, 959, 40)), axis=-1).reshape(-1, 2)
    rays = unproject(camera, grid)
    rays = rays[rays[:, 2] > np.cos(np.radians(115))]
    assert np.abs(project(read_camera(tmp_path / "a.cameramodel"), rays) - project(camera, rays)).max() < 0.01


def test_splines_that_are_not_read(tmp_path):
    path = tmp_path / "a.cameramodel"
    write_camera(path, rippled())
    text = path.read_text()
    for old, new in (("order=3", "order=2"), ("Nx=", "Nx=1"), ("fov_x_deg=", "fov_x_deg=9")):
        path.write_text(text.replace(old, new))
        with pytest.raises(FormatError):
            read_camera(path)


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("kind", ["opencv", "ros", "kalibr", "colmap"])
def test_other_formats_hold_the_best_fit_and_say_so(tmp_path, kind, base):
    camera = rippled(base, 0.5)
    path = tmp_path / "camera.file"
    fit = write_camera(path, camera, kind)
    back = read_camera(path)
    assert back.correction is None
    away = gap(back, camera)
    assert np.sqrt((away**2).mean()) == pytest.approx(fit.rms, rel=0.05)
    assert away.max() == pytest.approx(fit.largest, rel=0.15)
    assert f"{fit.rms:.4f} px RMS" in path.read_text()
    assert fit.rms < (
        0.6 if kind != "kalibr" else 6
    )  # ripples of half a pixel; k1 k2 alone don't follow the rational lens


def test_opencv_reads_the_best_fit(tmp_path):
    fit = write_camera(tmp_path / "a.yaml", rippled())
    file = cv2.FileStorage(str(tmp_path / "a.yaml"), cv2.FILE_STORAGE_READ)
    found, D = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    rays = unproject(rippled(), pixels())
    away = np.linalg.norm(opencv_pixels(found, D, False, rays) - pixels(), axis=1)
    assert away.max() == pytest.approx(fit.largest, rel=0.15)


def test_the_best_fit_of_a_lens_that_needs_no_correction_is_that_lens():
    for model, distortion in BASES.values():
        camera = Camera(K, np.array(distortion, float), SIZE, model)
        found, rms, largest = best_coefficients(camera, model)
        assert largest < (0.02 if model == "rational" else 1e-6)
        assert rms <= largest
        assert gap(found, camera).max() < 0.02
    wide = Camera(K * [[0.4], [0.4], [1]], np.zeros(4), SIZE, "fisheye")
    assert best_coefficients(wide, "brown")[1] == np.inf
    with pytest.raises(RcdnError, match="brown can show"):
        nearest_camera(wide, [("brown", 5)])
    with pytest.raises(FormatError, match="write json"):
        lens_fit("a.yaml", replace(wide, K=np.diag([1.0, 1, 1]), correction=zero_correction(rippled(), 8)))


def test_a_pair(tmp_path):
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation(np.array([0.01, -0.02, 0.03])), [-0.1, 0.002, 0.001]
    pair = StereoCameras(rippled("brown"), rippled("brown", 0.4), T)
    for kind in ("opencv", "kalibr", "mrcal", "json"):
        files = write_stereo(tmp_path / f"{kind}.file", pair, kind)
        back = read_stereo(*files)
        np.testing.assert_allclose(back.T_right_left, T, atol=1e-9)
        assert gap(back.left, pair.left).max() < {"json": 1e-9, "mrcal": 0.006}.get(kind, 2.5)
        assert gap(back.right, pair.right).max() < {"json": 1e-9, "mrcal": 0.006}.get(kind, 1.0)
        assert (kind != "json") == ("differs by" in files[0].read_text())


@pytest.mark.parametrize("base", BASES)
def test_maps_undistort_with_opencv(tmp_path, base):
    """A ramp of the rays' slopes becomes a ramp of pixels."""
    camera = rippled(base, 3.0).resized((320, 240))
    x, y = np.meshgrid(np.arange(320.0), np.arange(240.0))
    rays = unproject(camera, np.stack([x, y], axis=-1))
    write_maps(tmp_path / "maps.npz", camera)
    with np.load(tmp_path / "maps.npz") as found:
        map_x, map_y, flat = found["map_x"], found["map_y"], found["K"]
    assert map_x.shape == map_y.shape == (240, 320)
    assert map_x.dtype == map_y.dtype == np.float32
    for axis, grid in ((0, x), (1, y)):
        slope = rays[..., axis] / np.maximum(rays[..., 2], 0.2)
        after = cv2.remap(slope.astype(np.float32), map_x, map_y, cv2.INTER_LINEAR, borderValue=np.nan)
        truth = (grid - flat[axis, 2]) / flat[axis, axis]
        assert np.nanmax(np.abs(after - truth)[10:-10, 10:-10]) < 0.003  # a pixel is 0.005
        assert np.isfinite(after[50:-50, 50:-50]).all()


def test_maps_of_a_pair_rectify(tmp_path):
    left, right = rippled(), rippled("pinhole")
    R = rotation(np.array([0.0, 0.05, 0.0]))
    P_left, P_right = (np.column_stack([np.diag([400.0, 400, 1]), [t, 0, 0]]) for t in (0, -40))
    P_left[:2, 2] = P_right[:2, 2] = (320, 240)
    pair = StereoCameras(left, right, np.eye(4), Rectification(R, np.eye(3), P_left, P_right, np.eye(4)))
    files = write_stereo_maps(tmp_path / "maps.npz", pair)
    assert [f.name for f in files] == ["maps_left.npz", "maps_right.npz"]
    with np.load(files[0]) as found:
        assert set(found) == {"map_x", "map_y", "K", "R", "P", "Q"}
        at = np.stack([found["map_x"][200, 300], found["map_y"][200, 300]])
    ray = R.T @ np.linalg.solve(P_left[:, :3], [300, 200, 1])
    assert at == pytest.approx(project(left, ray), abs=1e-3)
    smaller = replace(pair, right=Camera(right.K / [[2], [2], [1]], right.distortion, (320, 240), right.model))
    for file in write_stereo_maps(tmp_path / "sizes.npz", smaller):  # both have the left one's size
        with np.load(file) as found:
            assert found["map_x"].shape == left.image_size[::-1]
    with pytest.raises(FormatError, match="which format"):
        camera_format(tmp_path / "maps.npz")

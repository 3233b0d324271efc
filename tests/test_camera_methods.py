"""A camera's own methods: what they compute is what the layers that know how compute."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image

import rcdn
from rcdn import camera_work
from rcdn.calibration.arguments import check_spacing
from rcdn.calibration.comparison import compare
from rcdn.calibration.difference import difference
from rcdn.calibration.next_view import next_view
from rcdn.errors import FormatError, ImageError, RcdnError
from rcdn.geometry import project, transform, zero_correction
from rcdn.geometry.resample import undistortion
from rcdn.io import read_image, read_rig
from rcdn.types import Camera, Pose
from rcdn_lab.camera_scenes import CAMERAS, random_boards, random_pose

RNG = np.random.default_rng(1)
POINTS = np.column_stack([RNG.uniform(-0.3, 0.3, (50, 2)), RNG.uniform(0.9, 2, 50)])
BROWN = CAMERAS["brown"]


@pytest.mark.parametrize("model", CAMERAS)
def test_rays_of_pixels_pass_through_the_points(model):
    camera = CAMERAS[model]
    xy = camera.project(POINTS)
    rays = camera.unproject(xy)
    along = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
    assert rays / np.linalg.norm(rays, axis=1, keepdims=True) == pytest.approx(along, abs=1e-8)
    assert np.array_equal(xy, project(camera, POINTS))


def test_lists_and_poses_are_taken():
    pose = Pose(random_pose(RNG))
    assert np.array_equal(BROWN.project(POINTS, pose), project(BROWN, transform(pose, POINTS)))
    assert BROWN.project([0, 0, 2]) == pytest.approx([330, 236])
    assert BROWN.project(POINTS.reshape(5, 10, 3).tolist()).shape == (5, 10, 2)
    assert np.isnan(BROWN.project([0, 0, -1])).all()


@pytest.mark.parametrize("shape", [(1, 5), (5, 1)])
def test_the_coefficients_are_taken_as_opencv_gives_them(shape):
    camera = Camera(BROWN.K, np.reshape(BROWN.distortion, shape), BROWN.image_size)
    assert camera.distortion.shape == (5,)
    assert np.array_equal(camera.project(POINTS), BROWN.project(POINTS))


@pytest.mark.parametrize("kind", [np.float32, np.int64, np.float64])
def test_a_camera_matrix_is_taken_column_by_column_too(kind):
    columns = np.array([[500, 0, 0], [0, 500, 0], [320, 240, 1]], kind)
    camera = Camera(columns.T, np.zeros(5), BROWN.image_size)
    assert np.array_equal(camera.project([0.1, 0.2, 1.0]), [370, 340])


@pytest.mark.parametrize(("model", "count"), [("pinhole", 0), ("brown", 5), ("rational", 8), ("fisheye", 4)])
def test_no_distortion_is_that_of_opencv(model, count):
    camera = Camera(BROWN.K, None, BROWN.image_size, model)
    assert camera.distortion.tolist() == [0] * count


def test_a_count_of_another_model_names_that_model():
    with pytest.raises(RcdnError, match="'brown' takes 4 or 5 numbers, not 8; model 'rational' takes 8"):
        Camera(BROWN.K, np.zeros(8), BROWN.image_size, "brown")
    with pytest.raises(RcdnError, match="'fisheye' takes 4 numbers, not 14; model 'rational' takes 14"):
        Camera(BROWN.K, np.zeros((1, 14)), BROWN.image_size, "fisheye")
    with pytest.raises(RcdnError, match="shape"):
        Camera(BROWN.K, np.zeros((2, 4)), BROWN.image_size)


@pytest.mark.parametrize("count", [8, 12, 14])
def test_rational_lenses_are_taken_as_opencv_gives_them(count):
    """With places for thin prisms and tilted sensors, whose numbers must be 0; no model need be named."""
    values = np.zeros((1, count))
    values[0, :8] = CAMERAS["rational"].distortion
    for camera in (Camera(BROWN.K, values, (640, 480)), Camera(BROWN.K, values, (640, 480), "rational")):
        assert (camera.model, len(camera.distortion)) == ("rational", 8)
        xy, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), BROWN.K, values)
        assert camera.project(POINTS) == pytest.approx(xy[:, 0], abs=1e-8)
    if count > 8:
        values[0, -1] = 0.01
        with pytest.raises(RcdnError, match=r"^Camera\.distortion: thin prisms and tilted sensors .* without them"):
            Camera(BROWN.K, values, (640, 480))


def test_what_opencv_calibrates_is_a_camera():
    boards = random_boards(CAMERAS["rational"], 1, views=8, whole=True)[0]
    points = [np.column_stack([board.ij, np.zeros(len(board))]).astype(np.float32) for board in boards]
    seen = [board.xy.astype(np.float32) for board in boards]
    size = CAMERAS["rational"].image_size
    for flags, model in ((0, "brown"), (cv2.CALIB_RATIONAL_MODEL, "rational")):
        _, K, D, rotations, shifts = cv2.calibrateCamera(points, seen, size, None, None, flags=flags)
        camera = Camera(K, D, size)
        assert camera.model == model
        placed = points[0] @ cv2.Rodrigues(rotations[0])[0].T + shifts[0].ravel()
        xy, _ = cv2.projectPoints(points[0], rotations[0], shifts[0], K, D)
        assert camera.project(placed) == pytest.approx(xy[:, 0], abs=1e-3)


def test_pinholes_are_as_opencv_has_them():
    xy, _ = cv2.projectPoints(POINTS, np.zeros(3), np.zeros(3), BROWN.K, BROWN.distortion)
    assert BROWN.project(POINTS) == pytest.approx(xy[:, 0], abs=1e-8)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: BROWN.project([1, 2]), r"points must have shape \(\.\.\., 3\), not \(2,\)"),
        (lambda: BROWN.project(POINTS, np.eye(4)), r"pose must be a Pose, not ndarray; .* Pose\(T\)"),
        (lambda: BROWN.unproject(3), r"xy must have shape \(\.\.\., 2\), not \(\)"),
        (lambda: BROWN.unproject([[1, 2], [3]]), "xy must hold numbers in rows of equal length"),
        (lambda: BROWN.undistorted(2), "balance"),
        (lambda: BROWN.undistorted(np.zeros((480, 640), np.uint8)), r"not ndarray; pictures go to undistort\(image\)"),
        (lambda: BROWN.undistort(np.zeros((480, 640), np.uint8), "all"), "balance must be a number, not str"),
        (lambda: BROWN.undistortion_maps([0.5]), "balance must be a number, not list"),
        (lambda: BROWN.undistort(np.zeros((10, 10), np.uint8)), "calibrated at 640×480"),
        (lambda: BROWN.undistort(np.ma.masked_less(np.zeros((480, 640), np.uint8), 9)), "masked pixels; fill them"),
        (lambda: BROWN.with_parameters([1, 2, 3]), "parameters must hold 9 numbers, not 3"),
        (lambda: BROWN.with_parameters("a"), "parameters must hold numbers"),
        (lambda: BROWN.with_parameters(None), "parameters must have shape"),
        (lambda: BROWN.with_parameters(np.ones((2, 9))), "parameters must have shape"),
        (lambda: compare(BROWN, None), "b must be a Camera or a Calibration, not NoneType"),
        (lambda: difference(BROWN, None, np.zeros((3, 2))), "b must be a Camera, not NoneType"),
        (lambda: next_view(BROWN), "calibration must be a Calibration, .* not Camera"),
        (lambda: check_spacing(True), "spacing is the side of one square"),
    ],
)
def test_wrong_arguments_are_named(call, words):
    with pytest.raises(RcdnError, match=words):
        call()


@pytest.mark.parametrize("image", ["a.png", None, np.zeros((480, 640), complex), np.zeros((0, 640), np.uint8), [1]])
def test_what_is_no_picture_is_said(image):
    with pytest.raises(ImageError, match="image must be"):
        BROWN.undistort(image)


def seen_disc(camera, ray, shape=(480, 640)):
    """A picture of a soft bright disc that `camera` sees in the direction of `ray`."""
    x, y = camera.project(ray)
    yy, xx = np.mgrid[: shape[0], : shape[1]]
    return np.exp(-((xx - x) ** 2 + (yy - y) ** 2) / 18) * 200


@pytest.mark.parametrize("model", ["brown", "fisheye"])
@pytest.mark.parametrize("balance", [0.0, 1.0])
def test_what_is_undistorted_is_where_the_flat_camera_sees_it(model, balance):
    camera = CAMERAS[model]
    flat = camera.undistorted(balance)
    assert (flat.model, flat.image_size) == ("pinhole", camera.image_size)
    for ray in ([0.1, 0.2, 1], [-0.3, 0.05, 1]):
        grey = seen_disc(camera, ray)
        picture = np.stack([grey, 255 - grey, 0 * grey], axis=2).astype(np.uint8)
        made = camera.undistort(picture, balance)
        assert made.shape == picture.shape
        assert made.dtype == np.uint8
        weight = made[:, :, 0].astype(float)
        x, y = np.meshgrid(np.arange(640), np.arange(480))
        centre = [(weight * x).sum() / weight.sum(), (weight * y).sum() / weight.sum()]
        assert centre == pytest.approx(flat.project(ray), abs=0.5)


def test_the_maps_are_those_of_remap():
    picture = seen_disc(BROWN, [0.1, 0.1, 1]).astype(np.float32)
    map_x, map_y = BROWN.undistortion_maps()
    assert map_x.shape == map_y.shape == (480, 640)
    made = cv2.remap(picture, map_x, map_y, cv2.INTER_CUBIC)[5:-5, 5:-5]
    assert made == pytest.approx(BROWN.undistort(picture)[5:-5, 5:-5], abs=1e-3)
    map_x[:] = 0  # theirs is a copy
    assert BROWN.undistortion_maps()[0].max() > 0
    assert np.array_equal(BROWN.undistort(Image.fromarray(picture)), BROWN.undistort(picture))


@pytest.mark.parametrize("name", ["a.yaml", "camera_info.yaml", "a.txt", "a.cameramodel", "a.json"])
def test_every_format_comes_back(tmp_path, name):
    assert BROWN.save(tmp_path / name) is None
    again = Camera.load(str(tmp_path / name))
    assert again.parameters == pytest.approx(BROWN.parameters, abs=1e-9)
    assert again.image_size == BROWN.image_size


def test_saving_says_what_a_format_cannot_hold(tmp_path):
    correction = zero_correction(BROWN, 5)
    bent = replace(BROWN, correction=correction.with_control(1e-3 * RNG.normal(size=correction.control.shape)))
    assert "best fit of" in bent.save(tmp_path / "a.yaml")
    assert bent.save(tmp_path / "a.json") is None
    assert np.array_equal(Camera.load(tmp_path / "a.json").parameters, bent.parameters)
    with pytest.raises(FormatError, match="which format"):
        BROWN.save(tmp_path / "a.xyz")
    with pytest.raises(FormatError, match="no lens model"):
        CAMERAS["fisheye"].save(tmp_path / "a.txt", format="mrcal")
    BROWN.save(tmp_path / "a.xyz", format="opencv")
    assert rcdn.Camera.load(tmp_path / "a.xyz").model == "brown"


def test_one_of_several_cameras_is_named(tmp_path):
    text = "# c\n1 PINHOLE 640 480 500 500 320 240\n2 PINHOLE 640 480 600 600 320 240\n"
    (tmp_path / "a.txt").write_text(text)
    assert Camera.load(tmp_path / "a.txt", name="2").K[0, 0] == 600
    with pytest.raises(FormatError, match="name one of them"):
        Camera.load(tmp_path / "a.txt")


@pytest.mark.parametrize("read", [Camera.load, read_rig, read_image])
@pytest.mark.parametrize("path", [None, 3])
def test_what_is_no_path_is_said(read, path):
    """A number would be a file that this process has open."""
    with pytest.raises(RcdnError, match=f"^path must be the name of a file, not {path}"):
        read(path)


def test_methods_need_nobody_to_have_imported_anything(tmp_path):
    code = (
        "from rcdn.types.camera import Camera; import numpy as np; "
        "print(*Camera(np.eye(3), [], (9, 9), 'pinhole').project([1, 2, 2]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout == "0.5 1.0\n"


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_floats_of_any_number_of_channels_are_resampled_alike(channels):
    """Also at the border, where OpenCV rounds float64."""
    rng = np.random.default_rng(0)
    picture = rng.uniform(size=(480, 640, channels))
    made = BROWN.undistort(picture)
    assert made.dtype == np.float64
    assert made.shape == picture.shape
    for k in range(channels):
        np.testing.assert_allclose(
            made[:, :, k], BROWN.undistort(picture[:, :, k].astype(np.float32)), rtol=0, atol=1e-6
        )
    assert np.array_equal(made[:, :, 0], BROWN.undistort(picture[:, :, 0]))


def test_pictures_with_a_palette_are_resampled_by_their_colours():
    rng = np.random.default_rng(0)
    rgb = Image.fromarray(rng.integers(0, 255, (480, 640, 3), np.uint8)).quantize(16)
    assert np.array_equal(BROWN.undistort(rgb), BROWN.undistort(rgb.convert("RGB")))
    dark = Image.fromarray(rng.uniform(size=(480, 640)) > 0.5)
    assert np.array_equal(BROWN.undistort(dark), BROWN.undistort(dark.convert("L")))


@pytest.mark.parametrize(
    "K", [2 * np.eye(3), [[500, 0, 320], [3, 500, 240], [0, 0, 1]], [[500, 0, 320], [0, 500, 240], [1e-3, 0, 1]]]
)
def test_a_matrix_that_is_no_cameras_is_refused(K):
    with pytest.raises(RcdnError, match=r"Camera\.K must be \[\[fx, skew, cx\]"):
        Camera(K, None, (640, 480), "pinhole")


@pytest.mark.parametrize(
    ("model", "distortion", "fold"),
    [("brown", [-0.3, 0.1, 0, 0, -0.02], 55.6), ("fisheye", [0.1, -0.05, -0.02, 0], 76.0)],
)
def test_what_lies_beyond_the_fold_of_a_lens_has_no_pixel(model, distortion, fold):
    """It would appear inside of the picture, at pixels that see something else."""
    camera = Camera(np.array([[600.0, 0, 319.5], [0, 600, 239.5], [0, 0, 1]]), np.array(distortion), (640, 480), model)
    angle = np.radians(np.arange(0, 120, 0.5))
    rays = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    seen = np.isfinite(camera.project(rays)).all(axis=1)
    assert np.degrees(angle[seen]).max() == pytest.approx(fold, abs=1)
    assert (np.diff(seen.astype(int)) <= 0).all()
    assert camera.project(rays[seen])[-1, 0] > 640  # outside of the picture, and still a pixel
    back = camera.unproject(camera.project(rays[seen]))
    assert back / np.linalg.norm(back, axis=1, keepdims=True) == pytest.approx(rays[seen], abs=1e-6)


@pytest.mark.parametrize("model", CAMERAS)
def test_a_resized_camera_sees_the_resized_picture(model):
    camera = CAMERAS[model]
    width, height = camera.image_size
    for size in ((width // 2, height // 2), (2 * width, 3 * height)):
        small = camera.resized(size)
        scale = np.divide(size, camera.image_size)
        assert small.image_size == size
        assert small.project(POINTS) == pytest.approx((camera.project(POINTS) + 0.5) * scale - 0.5, abs=1e-9)
    assert camera.resized([width, height]).K.tolist() == camera.K.tolist()


@pytest.mark.parametrize("model", CAMERAS)
def test_a_cropped_camera_sees_a_part_of_the_picture(model):
    camera = CAMERAS[model]
    part = camera.cropped(40, 30, 200, 100)
    assert part.image_size == (200, 100)
    assert part.project(POINTS) == pytest.approx(camera.project(POINTS) - [40, 30], abs=1e-9)


def test_a_smooth_correction_is_kept_in_resized_and_cropped_cameras():
    bent = replace(BROWN, correction=zero_correction(BROWN, 8))
    bent = replace(bent, correction=bent.correction.with_control(0.01 * RNG.normal(size=bent.correction.control.size)))
    half = np.divide(BROWN.image_size, 2).astype(int).tolist()
    assert bent.resized(half).project(POINTS) == pytest.approx((bent.project(POINTS) + 0.5) / 2 - 0.5, abs=1e-9)
    assert bent.cropped(8, 4, 100, 90).project(POINTS) == pytest.approx(bent.project(POINTS) - [8, 4], abs=1e-9)


@pytest.mark.parametrize("part", [(-1, 0, 9, 9), (0, 0, 10_000, 9), (600, 0, 100, 9), (0.5, 0, 9, 9), (0, None, 9, 9)])
def test_a_part_beyond_the_picture_is_refused(part):
    with pytest.raises(RcdnError, match="the part must lie within the picture of"):
        BROWN.cropped(*part)


def test_sizes_that_are_none_are_refused():
    with pytest.raises(RcdnError, match="size must be"):
        BROWN.resized(320)
    with pytest.raises(RcdnError, match="width and height must be"):
        BROWN.cropped(0, 0, 0, 10)


def test_cameras_and_balances_that_alternate_have_their_maps_made_once(monkeypatch):
    made = []
    monkeypatch.setattr(camera_work, "undistortion", lambda *given: made.append(given) or undistortion(*given))
    picture = np.zeros((480, 640), np.uint8)
    wanted = [(replace(CAMERAS[name]), balance) for name in ("brown", "fisheye") for balance in (0.0, 1.0)]
    for _ in range(3):
        for camera, balance in wanted:
            camera.undistort(picture, balance)
    assert made == wanted
    size = 640 * 480 * 9
    monkeypatch.setattr(camera_work, "KEPT", 2 * size)  # the last two
    for camera, balance in (wanted[3], wanted[2], wanted[3]):
        camera.undistort(picture, balance)
    assert made == wanted
    wanted[0][0].undistort(picture, wanted[0][1])
    assert len(made) == 5
    monkeypatch.setattr(camera_work, "KEPT", 0)  # but always the last
    wanted[0][0].undistort(picture, wanted[0][1])
    assert len(made) == 5


def test_threads_undistort_with_their_own_cameras():
    cameras = [replace(CAMERAS[name]) for name in ("brown", "fisheye", "pinhole")] * 2
    picture = seen_disc(BROWN, [0.1, 0.1, 1]).astype(np.uint8)
    alone = [undistortion(camera)(picture) for camera in cameras]
    with ThreadPoolExecutor(6) as pool:
        together = list(pool.map(lambda camera: [camera.undistort(picture) for _ in range(5)], cameras))
    for one, several in zip(alone, together, strict=True):
        assert all(np.array_equal(one, each) for each in several)

"""Camera files that other programs read and write: both see the same pixels."""

import json
import warnings

import cv2
import numpy as np
import pytest
import yaml
from camera_files import HELD, POINTS, SIZE, K, camera, mrcal, opencv_pixels, same_camera

from rcdn.errors import FormatError
from rcdn.geometry import project
from rcdn.io import (
    read_camera,
    read_cameras,
    read_stereo,
    write_camera,
)
from rcdn.types import Camera


@pytest.mark.parametrize("lens", [lens for kind, lens in HELD if kind == "opencv"])
def test_opencv_reads_it(tmp_path, lens):
    path = tmp_path / "a.yaml"
    write_camera(path, camera(lens))
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert (file.getNode("image_width").real(), file.getNode("image_height").real()) == SIZE
    found, D = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    np.testing.assert_array_equal(found, K)
    fisheye = bool(file.getNode("fisheye_model").real())
    assert fisheye == (lens == "fisheye")
    np.testing.assert_allclose(opencv_pixels(found, D, fisheye), project(camera(lens), POINTS), atol=1e-9)


@pytest.mark.parametrize("lens", [lens for kind, lens in HELD if kind == "ros"])
def test_yaml_readers_read_ros(tmp_path, lens):
    path = tmp_path / "camera_info.yaml"
    write_camera(path, camera(lens))
    data = yaml.safe_load(path.read_text())
    kind, many = {"fisheye": ("equidistant", 4), "rational": ("rational_polynomial", 8)}.get(lens, ("plumb_bob", 5))
    assert data["distortion_model"] == kind
    assert data["distortion_coefficients"]["cols"] == len(data["distortion_coefficients"]["data"]) == many
    assert (data["image_width"], data["image_height"]) == SIZE
    found = np.array(data["camera_matrix"]["data"]).reshape(3, 3)
    pixels = opencv_pixels(found, data["distortion_coefficients"]["data"], lens == "fisheye")
    np.testing.assert_allclose(pixels, project(camera(lens), POINTS), atol=1e-9)
    np.testing.assert_array_equal(np.reshape(data["rectification_matrix"]["data"], (3, 3)), np.eye(3))
    np.testing.assert_array_equal(np.reshape(data["projection_matrix"]["data"], (3, 4)), np.c_[K, np.zeros(3)])


@pytest.mark.parametrize("lens", [lens for kind, lens in HELD if kind == "kalibr"])
def test_yaml_readers_read_kalibr(tmp_path, lens):
    path = tmp_path / "camchain.yaml"
    write_camera(path, camera(lens))
    [(name, data)] = yaml.safe_load(path.read_text()).items()
    assert (name, data["camera_model"], data["resolution"]) == ("cam0", "pinhole", list(SIZE))
    assert data["distortion_model"] == ("equidistant" if lens == "fisheye" else "radtan")
    fx, fy, cx, cy = data["intrinsics"]
    found = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
    pixels = opencv_pixels(found, data["distortion_coeffs"], lens == "fisheye")
    np.testing.assert_allclose(pixels, project(camera(lens), POINTS), atol=1e-9)


@pytest.fixture(scope="module")
def pycolmap():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return pytest.importorskip("pycolmap", reason="pycolmap isn't installed: pip install pycolmap")


def reconstruction(pycolmap, folder):
    for name in ("images.txt", "points3D.txt"):
        (folder / name).touch()
    found = pycolmap.Reconstruction()
    found.read_text(str(folder))
    return found


@pytest.mark.parametrize("lens", [lens for kind, lens in HELD if kind == "colmap"])
def test_colmap_reads_it(tmp_path, pycolmap, lens):
    """Its pixels are ours and half a pixel."""
    if lens == "division" and "DIVISION" not in dir(pycolmap.CameraModelId):
        pytest.skip("this pycolmap doesn't know the DIVISION model: pip install -U pycolmap")
    write_camera(tmp_path / "cameras.txt", camera(lens))
    [(_, found)] = reconstruction(pycolmap, tmp_path).cameras.items()
    assert (found.width, found.height) == SIZE
    pixels = np.array([found.img_from_cam(p) for p in POINTS])
    np.testing.assert_allclose(pixels - 0.5, project(camera(lens), POINTS), atol=1e-9)


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("SIMPLE_PINHOLE", [700, 640, 360]),
        ("PINHOLE", [700, 710, 640, 360]),
        ("SIMPLE_RADIAL", [700, 640, 360, -0.05]),
        ("RADIAL", [700, 640, 360, -0.05, 0.01]),
        ("OPENCV", [700, 710, 640, 360, -0.05, 0.01, 1e-3, 2e-3]),
        ("FULL_OPENCV", [700, 710, 640, 360, -0.05, 0.01, 1e-3, 2e-3, 0.01, 0.02, 0.03, 0.04]),
        ("SIMPLE_RADIAL_FISHEYE", [700, 640, 360, -0.05]),
        ("RADIAL_FISHEYE", [700, 640, 360, -0.05, 0.01]),
        ("OPENCV_FISHEYE", [700, 710, 640, 360, -0.05, 0.01, 1e-3, 2e-3]),
        ("SIMPLE_DIVISION", [700, 640, 360, -0.05]),
        ("DIVISION", [700, 710, 640, 360, -0.05]),
    ],
)
def test_every_model_of_colmap_that_is_read(tmp_path, pycolmap, name, numbers):
    if name not in dir(pycolmap.CameraModelId):
        pytest.skip(f"this pycolmap doesn't know the model {name}: pip install -U pycolmap")
    theirs = pycolmap.Camera(camera_id=7, model=name, width=1280, height=720, params=numbers)
    made = pycolmap.Reconstruction()
    made.add_camera(theirs)
    made.write_text(str(tmp_path))
    assert list(read_cameras(tmp_path / "cameras.txt")) == ["7"]
    pixels = np.array([theirs.img_from_cam(p) for p in POINTS])
    np.testing.assert_allclose(project(read_camera(tmp_path / "cameras.txt"), POINTS), pixels - 0.5, atol=1e-9)


def test_the_centre_of_colmap_is_half_a_pixel_off(tmp_path):
    """A camera whose axis meets the centre of the top-left pixel."""
    write_camera(tmp_path / "cameras.txt", Camera(np.diag([100, 100, 1]), [], (64, 48), "pinhole"))
    assert (tmp_path / "cameras.txt").read_text().splitlines()[-1] == "1 PINHOLE 64 48 100.0 100.0 0.5 0.5"


@pytest.mark.parametrize("lens", [lens for kind, lens in HELD if kind == "mrcal"])
def test_mrcal_reads_it(tmp_path, lens):
    path = tmp_path / "a.cameramodel"
    write_camera(path, camera(lens))
    pixels, size, pose = mrcal(
        "m = mrcal.cameramodel(a[0])\n"
        "q = mrcal.project(np.array(json.loads(a[1])), *m.intrinsics())\n"
        "print(json.dumps([q.tolist(), m.imagersize().tolist(), m.extrinsics_rt_fromref().tolist()]))",
        path,
        json.dumps(POINTS.tolist()),
    )
    np.testing.assert_allclose(pixels, project(camera(lens), POINTS), atol=1e-9)
    assert size == list(SIZE)
    assert pose == [0] * 6


def test_what_mrcal_writes(tmp_path):
    path = tmp_path / "a.cameramodel"
    pixels = mrcal(
        "i = ('LENSMODEL_OPENCV8', np.array([700, 710, 640, 360, -.05, .01, 1e-3, 2e-3, .01, .02, .03, .04]))\n"
        "mrcal.cameramodel(intrinsics=i, imagersize=(1280, 720)).write(a[0], note='two\\nlines')\n"
        "print(json.dumps(mrcal.project(np.array(json.loads(a[1])), *i).tolist()))",
        path,
        json.dumps(POINTS.tolist()),
    )
    np.testing.assert_allclose(project(read_camera(path), POINTS), pixels, atol=1e-9)
    path.write_text(path.read_text().replace("OPENCV8", "CAHVOR"))
    with pytest.raises(FormatError, match="mrcal-convert-lensmodel"):
        read_camera(path)


NEW = ("image_width", "image_height", "camera_matrix", "distortion_coefficients")
OLD = ("image_Width", "image_Height", "Camera_Matrix", "Distortion_Coefficients")


@pytest.mark.parametrize(("names", "dtype"), [(NEW, np.float64), (OLD, np.float32)], ids=["new", "old"])
@pytest.mark.parametrize(("many", "fisheye"), [(5, None), (8, None), (14, None), (4, 0), (4, 1)])
def test_what_opencv_writes(tmp_path, many, fisheye, names, dtype):
    """As OpenCV's calibration samples do it, with the names of old ones and single precision, too."""
    D = np.zeros(many, dtype)
    D[: min(many, 8)] = [-0.05, 0.01, 1e-3, 2e-3, 0.01, 0.02, 0.03, 0.04][:many]
    path = tmp_path / "a.yml"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Sun 1 Jan 12:00:00")
    for name, value in zip(names, (*SIZE, K.astype(dtype), D[:, None]), strict=True):
        file.write(name, value)
    if fisheye is not None:
        file.write("fisheye_model", fisheye)
    file.write("per_view_reprojection_errors", np.full((3, 1), np.nan))
    file.writeComment("a comment")
    file.release()
    pixels = opencv_pixels(K.astype(dtype).astype(float), D.astype(float), fisheye)
    np.testing.assert_allclose(project(read_camera(path), POINTS), pixels, atol=1e-9 if dtype is np.float64 else 1e-3)


ROS_FILE = """image_width: 640
image_height: 480
camera_name: narrow
camera_matrix:
  rows: 3
  cols: 3
  data: [435.5,   0.  , 320.25,
           0.  , 436  , 239.75,
           0.  ,   0.  ,   1.  ]
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.1, 2e-02, 1e-05, -1.5e-4, 0]}
rectification_matrix:
  rows: 3
  cols: 3
  data:
    - 1
    - 0
    - 0
    - 0
    - 1
    - 0
    - 0
    - 0
    - 1
projection_matrix:
  rows: 3
  cols: 4
  data: [400, 0, 320, 0, 0, 400, 240, 0, 0, 0, 1, 0]
"""


def test_ros_files_in_all_their_forms(tmp_path):
    """Numbers without a point, exponents that YAML 1.1 takes for text, lists in lines and in brackets."""
    path = tmp_path / "a.yaml"
    path.write_text(ROS_FILE)
    found = read_camera(path)
    assert (found.model, found.image_size) == ("brown", (640, 480))
    assert found.parameters.tolist() == [435.5, 436, 320.25, 239.75, -0.1, 0.02, 1e-5, -1.5e-4, 0]
    path.write_text(ROS_FILE.replace("distortion_model: plumb_bob\n", ""))
    same_camera(read_camera(path), found)


def test_kalibr_files_as_kalibr_dumps_them(tmp_path):
    record = {
        "cam_overlaps": [1, 3],
        "camera_model": "pinhole",
        "distortion_coeffs": [-0.29, 0.08, 1e-05, 2e-05],
        "distortion_model": "radtan",
        "intrinsics": [461.5, 460.25, 362.5, 246.75],
        "resolution": [752, 480],
        "rostopic": "/cam0/image_raw",
    }
    data = {f"cam{k}": record | {"T_cn_cnm1": np.eye(4).tolist()} for k in (10, 2, 0)}
    (tmp_path / "a.yaml").write_text(yaml.dump(data))
    assert list(read_cameras(tmp_path / "a.yaml")) == ["cam0", "cam2", "cam10"]
    with pytest.raises(FormatError, match="holds the cameras cam0, cam2, cam10; name one"):
        read_camera(tmp_path / "a.yaml")
    with pytest.raises(FormatError, match="not 'left'"):
        read_camera(tmp_path / "a.yaml", name="left")
    found = read_camera(tmp_path / "a.yaml", name="cam2")
    assert found.parameters.tolist() == [461.5, 460.25, 362.5, 246.75, -0.29, 0.08, 1e-5, 2e-5]
    with pytest.raises(FormatError, match="holds 3 cameras, not a pair"):
        read_stereo(tmp_path / "a.yaml")


MESSAGE = """header:
  frame_id: camera
height: 480
width: 640
distortion_model: {model}
{d}: {D}
{k}: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0]
{r}: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
{p}: [500.0, 0.0, 320.0, 0.0, 0.0, 501.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0]
roi:
  x_offset: 0
---
"""


@pytest.mark.parametrize("names", ["dkrp", "DKRP"])  # of ROS 2 and ROS 1
@pytest.mark.parametrize(
    ("model", "D", "lens"),
    [
        ("plumb_bob", [0.1, -0.2, 0.001, 0.002, 0.0], "brown"),
        ("rational_polynomial", [0.1, -0.2, 0.001, 0.002, 0.01, 0.02, 0.03, 0.04], "rational"),
        ("equidistant", [0.1, -0.2, 0.01, 0.002], "fisheye"),
    ],
)
def test_messages_of_ros_are_read(tmp_path, names, model, D, lens):
    path = tmp_path / "message.yaml"
    path.write_text(MESSAGE.format(model=model, D=D, **dict(zip("dkrp", names, strict=True))))
    found = read_camera(path)
    np.testing.assert_array_equal(found.K, [[500, 0, 320], [0, 501, 240], [0, 0, 1]])
    assert (found.model, found.distortion.tolist(), found.image_size) == (lens, D, (640, 480))


@pytest.mark.parametrize(("last", "reads"), [(0.0, True), (0.01, False)])
def test_ros_may_write_zeros_for_a_thin_prism(tmp_path, last, reads):
    D, path = [0.1, -0.2, 0.001, 0.002, 0.01, 0.02, 0.03, 0.04, 0, 0, 0, 0, 0, last], tmp_path / "message.yaml"
    path.write_text(MESSAGE.format(model="rational_polynomial", D=D, d="d", k="k", r="r", p="p"))
    if reads:
        assert read_camera(path).distortion.tolist() == D[:8]
        return
    with pytest.raises(FormatError, match="thin prisms"):
        read_camera(path)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ("binning_x: 2\nbinning_y: 2", "binned by 2 × 2, but K is of the whole 640×480 px"),
        (
            "roi: {x_offset: 40, y_offset: 30, height: 420, width: 560}",
            r"cropped to 560×420 px at \(40, 30\), but K is",
        ),
        ("binning_x: 2\nroi: {y_offset: 8}", r"binned by 2 × 1 and cropped to 640×480 px at \(0, 8\)"),
        ("binning_x: 1\nbinning_y: 0\nroi: {x_offset: 0, y_offset: 0, height: 480, width: 640}", ""),
        ("roi: {x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: true}", ""),
    ],
)
def test_a_message_of_binned_or_cropped_pictures_is_refused(tmp_path, fields, words):
    path = tmp_path / "message.yaml"
    D = [0.1, -0.2, 0.001, 0.002, 0.0]
    text = MESSAGE.format(model="plumb_bob", D=D, d="d", k="k", r="r", p="p")
    path.write_text(text.replace("roi:\n  x_offset: 0", fields))
    if not words:
        assert read_camera(path).image_size == (640, 480)
        return
    with pytest.raises(FormatError, match=words):
        read_camera(path)
    with pytest.raises(FormatError, match=words):
        read_stereo(path, path)

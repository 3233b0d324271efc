"""Files of rigs: round trips, what other programs make of them, and refusals."""

import importlib.util
import json
import subprocess
import sys
import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from camera_files import camera, same_camera
from scipy.spatial.transform import Rotation
from test_stereo_files import pair, same_pair
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.errors import FormatError, RcdnError
from rcdn.geometry import rotation, zero_correction
from rcdn.io import (
    StereoCameras,
    read_camera,
    read_cameras,
    read_rig,
    read_stereo,
    rig_format,
    rig_paths,
    write_rig,
    write_stereo,
)
from rcdn.types import LensCorrection, Pose, Rig

NAMES = {
    "kalibr": "camchain.yaml",
    "aniposelib": "rig.toml",
    "caliscope": "camera_array.toml",
    "colmap": "rig_config.json",
    "opencv": "rig.yaml",
    "ros": "camera_info.yaml",
    "json": "rig.json",
}
NAMELESS = ("kalibr", "caliscope")
"""formats that know cameras by numbers only"""
LENSES = ("brown4", "fisheye", "pinhole")


def rig(lenses=LENSES, covariance=None):
    """Cameras on a ring that look at its middle, each 1 m from it."""
    turns = [rotation(np.array([0.1, 2 * np.pi * k / len(lenses), 0.05])) for k in range(len(lenses))]
    places = []
    for R in turns:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, (0, 0, 1)
        places.append(T)
    first = np.linalg.inv(places[0])
    names = tuple(f'view "{k}" é' for k in range(len(lenses)))
    return Rig(names, tuple(camera(lens) for lens in lenses), tuple(Pose(T @ first) for T in places), covariance)


def same_rig(a, b):
    assert len(a) == len(b)
    for one, other in zip(a.cameras, b.cameras, strict=True):
        same_camera(one, other)
    for one, other in zip(a.poses, b.poses, strict=True):
        np.testing.assert_allclose(one.T_cam_board, other.T_cam_board, atol=1e-13)


@pytest.mark.parametrize("kind", NAMES)
def test_every_format_gives_the_rig_back(tmp_path, kind):
    made = rig()
    path = tmp_path / NAMES[kind]
    assert rig_format(path) == kind
    assert write_rig(path, made) == [None] * 3
    found = read_rig(path)
    same_rig(made, found)
    if kind not in NAMELESS:
        assert found.names == made.names


def test_more_than_ten_cameras_keep_their_order(tmp_path):
    made = rig(("brown4",) * 12)
    for name in NAMES.values():
        write_rig(tmp_path / name, made)
        same_rig(made, read_rig(tmp_path / name))
    tables = tomllib.loads((tmp_path / "rig.toml").read_text("utf-8"))
    ordered = [tables[key]["name"] for key in sorted(tables) if key != "metadata"]  # as aniposelib reads them
    assert tuple(ordered) == made.names


def test_json_keeps_the_covariance(tmp_path):
    root = np.random.default_rng(3).normal(size=(18, 30))
    made = rig(covariance=root @ root.T)
    write_rig(tmp_path / "rig.json", made)
    np.testing.assert_array_equal(read_rig(tmp_path / "rig.json").covariance, made.covariance)
    assert list(read_cameras(tmp_path / "rig.json")) == list(made.names)


def test_a_camchain_tells_each_place_after_the_one_before(tmp_path):
    made = rig()
    write_rig(tmp_path / "camchain.yaml", made)
    data = yaml.safe_load((tmp_path / "camchain.yaml").read_text())
    for k in (1, 2):
        T = np.array(data[f"cam{k}"]["T_cn_cnm1"])
        np.testing.assert_allclose(T @ made.poses[k - 1].T_cam_board, made.poses[k].T_cam_board, atol=1e-12)
    assert data["cam1"]["cam_overlaps"] == [0, 2]


MIDDLE = np.random.default_rng(0).uniform(-0.2, 0.2, (20, 3)) + np.array([0, 0, 1])
"""points that all cameras see, in the rig's frame"""


@pytest.mark.parametrize("kind", ["aniposelib", "caliscope"])
def test_opencv_projects_by_the_numbers_of_the_toml_what_we_do(tmp_path, kind):
    """Both programs hand these numbers to OpenCV."""
    made = rig()
    write_rig(tmp_path / NAMES[kind], made)
    data = tomllib.loads((tmp_path / NAMES[kind]).read_text("utf-8"))
    tables = [t for t in data.get("cameras", data).values() if "matrix" in t]
    for table, own, pose in zip(tables, made.cameras, made.poses, strict=True):
        rvec, tvec, K, d = (np.array(table[k], float) for k in ("rotation", "translation", "matrix", "distortions"))
        project = cv2.fisheye.projectPoints if table["fisheye"] else cv2.projectPoints
        theirs = project(MIDDLE[:, None], rvec, tvec, K, d)[0].reshape(-1, 2)
        np.testing.assert_allclose(theirs, own.project(MIDDLE @ pose.R.T + pose.t), atol=1e-6)


@pytest.mark.parametrize(("names", "kept"), [(("3", "1", "7"), True), (("01", "1", "7"), False)])
def test_cameras_that_are_numbered_keep_their_numbers(tmp_path, names, kept):
    made = replace(rig(), names=names)
    write_rig(tmp_path / "camera_array.toml", made)
    again = read_rig(tmp_path / "camera_array.toml")
    assert again.names == (names if kept else ("0", "1", "2"))
    assert [c.K.tolist() for c in again.cameras] == [c.K.tolist() for c in made.cameras]


@pytest.mark.parametrize("name", ["pair.yaml", "pair.json"])
def test_a_file_of_two_cameras_is_a_rig(tmp_path, name):
    made = rig(("brown4", "brown4"))
    T = made.poses[1].T_cam_board @ np.linalg.inv(made.poses[0].T_cam_board)
    write_stereo(tmp_path / name, StereoCameras(*made.cameras, T))
    found = read_rig(tmp_path / name)
    assert found.names == ("left", "right")
    np.testing.assert_allclose(found.relative("left", "right")[0], T, atol=1e-9)


def test_a_broken_file_of_two_cameras_is_told_what_it_lacks(tmp_path):
    made = rig(("brown4", "brown4"))
    write_stereo(tmp_path / "pair.yaml", StereoCameras(*made.cameras, np.eye(4)))
    whole = (tmp_path / "pair.yaml").read_text()
    (tmp_path / "pair.yaml").write_text(whole.replace("T: !!", "X: !!"))
    with pytest.raises(FormatError, match=r"pair\.yaml: 'T' must be a 3 × 1 matrix"):
        read_rig(tmp_path / "pair.yaml")


def test_a_file_of_one_camera_is_no_rig(tmp_path):
    rig().cameras[0].save(tmp_path / "one.yaml")
    with pytest.raises(FormatError, match="holds no rig"):
        read_rig(tmp_path / "one.yaml")


def test_poses_of_a_rig_are_poses():
    with pytest.raises(RcdnError, match="tuple\\(map\\(Pose, T\\)\\)"):
        replace(rig(), poses=rig().T_cam_rig)


READERS = {
    "aniposelib": """
from aniposelib.cameras import CameraGroup
cameras = CameraGroup.load(path).cameras
names, seen = [c.get_name() for c in cameras], [c.project(points) for c in cameras]
""",
    "pycolmap": """
import pycolmap
(rig,) = pycolmap.read_rig_config(path)
names, seen, places = [c.image_prefix.rstrip("/") for c in rig.cameras], [], []
for c in rig.cameras:
    mine = points if c.ref_sensor else points @ c.cam_from_rig.rotation.matrix().T + c.cam_from_rig.translation
    seen.append(c.camera.img_from_cam(mine) - 0.5)
""",
    "caliscope": """
import cv2
from caliscope.cameras.camera_array import CameraArray
names, seen = [], []
for number, c in CameraArray.from_toml(path).cameras.items():
    names.append(str(number))
    project = cv2.fisheye.projectPoints if c.fisheye else cv2.projectPoints
    seen.append(project(points[:, None], cv2.Rodrigues(c.rotation)[0], c.translation, c.matrix, c.distortions)[0])
""",
}


@pytest.mark.parametrize("program", READERS)
def test_the_programs_themselves_read_and_project_what_we_do(tmp_path, program):
    if importlib.util.find_spec(program) is None:
        pytest.skip(f"{program} isn't installed (python -m tests.environments {program})")
    made = rig()
    path = tmp_path / NAMES[program.removeprefix("py")]
    write_rig(path, made)
    head = f"import json, numpy as np\npath, points = {str(path)!r}, np.array({MIDDLE.tolist()})"
    tail = "print(json.dumps([names, [np.reshape(xy, (-1, 2)).tolist() for xy in seen]]))"
    words = [sys.executable, "-c", head + READERS[program] + tail]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=300)
    names, theirs = json.loads(done.stdout.splitlines()[-1])
    assert names == (["0", "1", "2"] if program == "caliscope" else list(made.names))
    for xy, own, pose in zip(theirs, made.cameras, made.poses, strict=True):
        np.testing.assert_allclose(xy, own.project(MIDDLE @ pose.R.T + pose.t), atol=1e-6)


@pytest.mark.parametrize("name", ["cameras.txt", "rig.cameramodel"])
def test_formats_without_a_place_for_a_rig_are_refused(tmp_path, name):
    with pytest.raises(FormatError, match=r"no place for a rig; name the file camchain\.yaml"):
        write_rig(tmp_path / name, rig())
    assert not (tmp_path / name).exists()


def test_a_lens_that_the_format_lacks_is_named_with_its_camera(tmp_path):
    with pytest.raises(
        FormatError,
        match=r"camera view \"1\" é: Kalibr's camchain: radtan holds .* or write \.toml, opencv, ros, colmap or json",
    ):
        write_rig(tmp_path / "camchain.yaml", rig(("brown4", "rational")))
    with pytest.raises(FormatError, match=r"camera view \"0\" é: .* no lens model for 'division'"):
        write_rig(tmp_path / "rig.toml", rig(("division", "pinhole")))
    for name in ("rig.yaml", "camera_info.yaml"):
        with pytest.raises(FormatError, match=r"camera view \"0\" é: .*division"):
            write_rig(tmp_path / name, rig(("division", "pinhole")))
    assert not list(tmp_path.iterdir())  # none of one file a camera either


BROKEN = {
    "rig.toml": ["", "x = ", "[cam_0]\nmatrix = 3\nrotation = 1\nsize = [1, 2]", "cameras = 3"],
    "rig.json": ["{}", "[]", '{"version": 1, "kind": "camera"}', '{"version": 1, "kind": "rig"}'],
    "camchain.yaml": ["", "cam0: 3", "[1, 2"],
    "rig_config.json": ["[", "[]", "[3]", '[{"cameras": 3}]', '[{"cameras": [{"image_prefix": "a"}]}]'],
}


@pytest.mark.parametrize(("name", "text"), [(n, t) for n, texts in BROKEN.items() for t in texts])
def test_broken_files_are_refused_by_name(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(FormatError, match=name.replace(".", r"\.")):
        read_rig(tmp_path / name)


def test_a_turn_that_is_none_and_names_that_no_camera_has_are_refused(tmp_path):
    path = tmp_path / "rig.json"
    write_rig(path, rig())
    data = json.loads(path.read_text())
    path.write_text(json.dumps(data | {"names": ["a", "b", {}]}))
    with pytest.raises(FormatError, match="'names' must be those"):
        read_rig(path)
    data["cameras"][1]["T_cam_rig"][0][0] += 0.1
    path.write_text(json.dumps(data))
    with pytest.raises(FormatError, match=r"cameras\[1\]: 'T_cam_rig' is no rotation"):
        read_rig(path)


def test_opencv_reads_each_cameras_file_and_projects_what_we_do(tmp_path):
    made = rig()
    write_rig(tmp_path / "rig.yaml", made)
    paths = rig_paths(tmp_path / "rig.yaml", made.names)
    assert sorted(paths) == sorted(tmp_path.iterdir())
    for path, own, pose, name in zip(paths, made.cameras, made.poses, made.names, strict=True):
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        K, d, R, t = (file.getNode(k).mat() for k in ("camera_matrix", "distortion_coefficients", "R", "T"))
        assert file.getNode("camera_name").string() == name
        project = cv2.fisheye.projectPoints if file.getNode("fisheye_model").real() else cv2.projectPoints
        theirs = project(MIDDLE[:, None], cv2.Rodrigues(R)[0], t, K, d)[0].reshape(-1, 2)
        np.testing.assert_allclose(theirs, own.project(MIDDLE @ pose.R.T + pose.t), atol=1e-6)
        same_camera(read_camera(path), own)


def test_ros_transforms_place_the_cameras_as_tf_has_it(tmp_path):
    """A transform takes coordinates in the child's frame to the parent's; frames are optical ones, of REP 103."""
    made = rig()
    write_rig(tmp_path / "camera_info.yaml", made)
    *infos, tree = rig_paths(tmp_path / "camera_info.yaml", made.names)
    for k, each in enumerate(yaml.safe_load(tree.read_text("utf-8"))["transforms"], start=1):
        assert each["header"]["frame_id"] == f"{made.names[0]}_optical_frame"
        assert each["child_frame_id"] == f"{made.names[k]}_optical_frame"
        t, q = (
            [each["transform"][part][n] for n in axes] for part, axes in (("translation", "xyz"), ("rotation", "xyzw"))
        )
        first, own = (MIDDLE @ made.poses[n].R.T + made.poses[n].t for n in (0, k))
        np.testing.assert_allclose(own @ Rotation.from_quat(q).as_matrix().T + t, first, atol=1e-12)
        project = cv2.fisheye.projectPoints if made.cameras[k].model == "fisheye" else cv2.projectPoints
        info = yaml.safe_load(infos[k].read_text("utf-8"))
        K, d = (np.array(info[key]["data"]) for key in ("camera_matrix", "distortion_coefficients"))
        theirs = project(own[:, None], np.zeros(3), np.zeros(3), K.reshape(3, 3), d)[0].reshape(-1, 2)
        np.testing.assert_allclose(theirs, made.cameras[k].project(own), atol=1e-6)


@pytest.mark.parametrize("kind", ["opencv", "ros"])
def test_files_of_a_folder_are_one_rig_in_any_order(tmp_path, kind):
    made = rig()
    write_rig(tmp_path / NAMES[kind], made)
    for files in (sorted(tmp_path.iterdir()), sorted(tmp_path.iterdir(), reverse=True)):
        found = read_rig(*files)
        assert found.names == made.names
        same_rig(made, found)


@pytest.mark.parametrize("kind", ["aniposelib", "caliscope"])
@pytest.mark.parametrize("angle", [0, 1e-9, 1e-5, np.pi - 1e-6, np.pi])
def test_small_turns_and_half_turns_are_kept(tmp_path, kind, angle):
    turned = np.eye(4)
    turned[:3, :3] = rotation(angle * np.array([0.6, 0, 0.8]))
    made = Rig(("a", "b"), (camera("brown4"),) * 2, (Pose(np.eye(4)), Pose(turned)))
    write_rig(tmp_path / NAMES[kind], made)
    found = read_rig(tmp_path / NAMES[kind])
    np.testing.assert_allclose(found.poses[1].T_cam_board, turned, atol=1e-13)


def test_two_files_of_a_rig_of_two_are_converted_as_a_rig(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = rig(("brown4", "brown4"))
    plain = Rig(("a", "b"), made.cameras, made.poses)
    write_rig("rig.yaml", plain)
    assert CliRunner().invoke(app, ["convert", "rig_a.yaml", "rig_b.yaml", "back.json"]).exit_code == 0
    same_rig(plain, read_rig("back.json"))


@pytest.mark.parametrize("name", ["camera_info_both.yaml", "both.cameramodel"])
def test_files_of_a_pair_with_a_camera_each_are_a_rig(tmp_path, name):
    made = pair()
    files = write_stereo(tmp_path / name, made)
    assert len(files) == 2
    for given in ([tmp_path / name], files, files[::-1] if "info" in name else files):
        found = read_rig(*given)
        assert found.names == ("left", "right")
        for one, other in zip(found.cameras, (made.left, made.right), strict=True):
            same_camera(one, other)
        np.testing.assert_allclose(found.T_cam_rig, [np.eye(4), made.T_right_left], atol=1e-12)


def test_files_of_opencvs_stereo_sample_are_a_rig(tmp_path):
    whole = write_stereo(tmp_path / "pair.yaml", pair())[0].read_text()
    head, rest = whole.split("R: !!", 1)
    (tmp_path / "intrinsics.yml").write_text(head)
    (tmp_path / "extrinsics.yml").write_text("%YAML:1.0\n---\nR: !!" + rest)
    found = read_rig(tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml")
    np.testing.assert_allclose(found.T_cam_rig[1], pair().T_right_left, atol=1e-12)


def test_the_name_of_a_ros_pair_is_converted_with_its_rectification(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_stereo("camera_info.yaml", pair())
    done = CliRunner().invoke(app, ["convert", "camera_info.yaml", "back.json"])
    assert done.exit_code == 0, done.output
    same_pair(read_stereo("back.json"), pair())
    done = CliRunner().invoke(app, ["convert", "camera_info_left.yaml", "camera_info_right.yaml", "back.toml"])
    assert done.exit_code == 0, done.output
    assert read_rig("back.toml").names == ("left", "right")


def test_what_one_file_a_camera_lacks_is_named(tmp_path):
    made = rig(("brown4", "pinhole"))
    plain = Rig(("a", "b"), made.cameras, made.poses)
    write_rig(tmp_path / "camera_info.yaml", plain)
    files = rig_paths(tmp_path / "camera_info.yaml", plain.names)
    with pytest.raises(FormatError, match="file of transforms"):
        read_rig(*files[:2])
    other = files[2].read_text().replace("b_optical_frame", "c_optical_frame")
    files[2].write_text(other)
    with pytest.raises(FormatError, match="has no frame of b"):
        read_rig(*files)
    with pytest.raises(FormatError, match="can't be a part of a file's name"):
        write_rig(tmp_path / "rig.yaml", Rig(("a/b", "c"), made.cameras, made.poses))
    write_rig(tmp_path / "rig.yaml", plain)
    with pytest.raises(FormatError, match="holds no rig; of one file a camera"):
        read_rig(tmp_path / "rig_a.yaml")


def test_colmaps_file_without_lenses_or_sizes_is_refused_with_what_to_add(tmp_path):
    path = tmp_path / "rig_config.json"
    write_rig(path, rig())
    data = json.loads(path.read_text("utf-8"))
    del data[0]["cameras"][1]["width"], data[0]["cameras"][1]["height"]
    path.write_text(json.dumps(data))
    with pytest.raises(FormatError, match=r"cameras\[1\] .*has no width and no height; add"):
        read_rig(path)
    path.write_text(json.dumps(data * 2))
    with pytest.raises(FormatError, match="holds 2 rigs"):
        read_rig(path)


@pytest.mark.parametrize("source", NAMES)
def test_convert_takes_every_format_to_every_other(tmp_path, monkeypatch, source):
    monkeypatch.chdir(tmp_path)
    made = rig()
    write_rig(f"in_{NAMES[source]}", made)
    for target, name in NAMES.items():
        done = CliRunner().invoke(app, ["convert", f"in_{NAMES[source]}", name])
        assert done.exit_code == 0, done.output
        found = read_rig(name)
        same_rig(made, found)
        assert found.names == read_rig(f"in_{NAMES[source]}").names or target in NAMELESS


def test_convert_says_what_is_lost_and_refuses_a_lens_that_is_not_held(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    made = rig(covariance=np.eye(18))
    zero = zero_correction(made.cameras[0], 12)
    ripples = 1e-3 * np.random.default_rng(0).normal(size=zero.control.shape)
    correction = LensCorrection(ripples, zero.extent)
    bent = replace(made, cameras=(replace(made.cameras[0], correction=correction), *made.cameras[1:]))
    write_rig("rig.json", bent)
    done = CliRunner().invoke(app, ["convert", "rig.json", "rig.toml"])
    assert done.exit_code == 1
    assert 'can\'t hold the lens of camera view "0" é' in done.stderr
    assert not (tmp_path / "rig.toml").exists()
    done = CliRunner().invoke(app, ["convert", "rig.json", "rig.toml", "--lossy"])
    assert done.exit_code == 0, done.output
    assert "holds no covariance" in done.stderr
    assert (tmp_path / "rig.toml").read_text("utf-8").startswith('# camera view "0" é: best fit of')
    assert len(read_rig("rig.toml")) == 3

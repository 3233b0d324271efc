"""Files of two cameras: round trips, what other programs make of them, and refusals."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from camera_files import HELD, LENSES, SIZE, K, camera, mrcal, same_camera

from rcdn.errors import FormatError, RcdnError
from rcdn.io import (
    Rectification,
    StereoCameras,
    read_camera,
    read_cameras,
    read_stereo,
    write_camera,
    write_stereo,
)
from rcdn.types import Camera

HOLD_STEREO = ("opencv", "ros", "kalibr", "mrcal", "json")
HOLD_TURNS = ("opencv", "ros", "json")


def pair(lens="brown4", turn=(0.02, -0.3, 0.01), shift=(-0.12, 0.004, 0.01), rectified=True):
    left, right = camera(lens), Camera(K + np.diag([3.0, -2, 0]), LENSES[lens][1], SIZE, LENSES[lens][0])
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = cv2.Rodrigues(np.array(turn, float))[0], shift
    zeros = np.zeros(5)
    turns = cv2.stereoRectify(left.K, zeros, right.K, zeros, SIZE, T[:3, :3], T[:3, 3:], flags=0)[:5]
    return StereoCameras(left, right, T, Rectification(*turns) if rectified else None)


def same_pair(a, b, turns=True):
    for side in ("left", "right"):
        same_camera(getattr(a, side), getattr(b, side))
    np.testing.assert_allclose(a.T_right_left, b.T_right_left, atol=1e-14)
    assert (b.rectification is not None) == turns
    for name in ("R_left", "R_right", "P_left", "P_right", "Q") if turns else ():
        theirs = getattr(b.rectification, name)
        np.testing.assert_allclose(getattr(a.rectification, name), theirs, atol=1e-12, rtol=1e-12)


@pytest.mark.parametrize("shift", [(-0.12, 0.004, 0.01), (0.003, -0.2, 0.01)], ids=["beside", "above"])
@pytest.mark.parametrize(("kind", "lens"), [(k, lens) for k, lens in HELD if k in HOLD_STEREO])
def test_stereo_round_trip(tmp_path, kind, lens, shift):
    made = pair(lens, shift=shift)
    files = write_stereo(tmp_path / "pair.file", made, kind)
    names = ["pair.file"] if kind in ("opencv", "kalibr", "json") else ["pair_left.file", "pair_right.file"]
    assert [f.name for f in files] == names == sorted(f.name for f in tmp_path.iterdir())
    same_pair(made, read_stereo(*files), kind in HOLD_TURNS)
    if len(files) == 1:
        left, right = read_cameras(files[0]).values()
        same_camera(left, made.left)
        same_camera(right, made.right)
        with pytest.raises(FormatError, match="holds the cameras"):
            read_camera(files[0])
    else:
        same_camera(read_camera(files[1]), made.right)
        with pytest.raises(FormatError, match="give the right camera's, too"):
            read_stereo(files[0])


@pytest.mark.parametrize("kind", ["opencv", "kalibr", "mrcal", "json"])
def test_a_pair_without_rectification(tmp_path, kind):
    made = pair(rectified=False)
    same_pair(made, read_stereo(*write_stereo(tmp_path / "a", made, kind)), turns=False)


def test_what_cannot_hold_a_pair(tmp_path):
    with pytest.raises(FormatError, match="no place for the pose"):
        write_stereo(tmp_path / "cameras.txt", pair())
    mixed = StereoCameras(camera("brown4"), camera("fisheye"), np.eye(4))
    with pytest.raises(FormatError, match=r"right camera: mrcal's \.cameramodel has no lens model for 'fisheye'"):
        write_stereo(tmp_path / "a.cameramodel", mixed)
    assert list(tmp_path.iterdir()) == []
    write_camera(tmp_path / "cameras.txt", camera())
    with pytest.raises(FormatError, match="no place for the pose"):
        read_stereo(tmp_path / "cameras.txt")


@pytest.mark.parametrize("lenses", [("fisheye", "brown4"), ("brown5", "fisheye"), ("pinhole", "fisheye")])
@pytest.mark.parametrize("kind", ["opencv", "ros", "json", "kalibr"])
def test_a_fisheye_beside_a_normal_lens(tmp_path, kind, lenses):
    made = replace(pair(), left=camera(lenses[0]), right=camera(lenses[1]))
    if kind == "kalibr" and "brown5" in lenses:
        with pytest.raises(FormatError, match="left camera: Kalibr's camchain: radtan holds k1 k2 p1 p2 only"):
            write_stereo(tmp_path / "a", made, kind)
    else:
        same_pair(made, read_stereo(*write_stereo(tmp_path / "a", made, kind)), kind in HOLD_TURNS)


@pytest.mark.parametrize("angle", [0, 1e-9, 1e-6, 1e-3, 3.0, np.pi - 1e-6, np.pi])
def test_mrcal_holds_every_turn(tmp_path, angle):
    """Tiny ones and half turns, too, to 1e-14."""
    for axis in np.concatenate([np.eye(3), np.random.default_rng(0).normal(size=(5, 3))]):
        made = pair(turn=angle * axis / np.linalg.norm(axis))
        back = read_stereo(*write_stereo(tmp_path / "a", made, "mrcal"))
        np.testing.assert_allclose(back.T_right_left, made.T_right_left, atol=1e-14)


def test_mrcal_reads_the_pair(tmp_path):
    made = pair()
    files = write_stereo(tmp_path / "a.cameramodel", made)
    Rt = mrcal(
        "l, r = map(mrcal.cameramodel, a)\n"
        "print(json.dumps(mrcal.compose_Rt(r.extrinsics_Rt_fromref(), l.extrinsics_Rt_toref()).tolist()))",
        *files,
    )
    np.testing.assert_allclose(Rt, np.concatenate([made.T_right_left[:3, :3], made.T_right_left[:3, 3:].T]), atol=1e-12)


def test_mrcal_pairs_with_another_reference(tmp_path):
    """Neither camera is the reference; the newer name of the field."""
    T_left_ref, made = pair(turn=(0.3, 0.1, -0.2), shift=(1, 2, 3)).T_right_left, pair()
    for side, T in (("left", T_left_ref), ("right", made.T_right_left @ T_left_ref)):
        rt = [*cv2.Rodrigues(T[:3, :3])[0].ravel(), *T[:3, 3]]
        numbers = [*K[[0, 1, 0, 1], [0, 1, 2, 2]], *LENSES["brown4"][1]]
        record = {"lensmodel": "LENSMODEL_OPENCV4", "intrinsics": [float(v) for v in numbers], "imagersize": SIZE}
        record["extrinsics" if side == "left" else "rt_cam_ref"] = tuple(map(float, rt))
        (tmp_path / side).write_text(f"# made by hand\n{record!r}")
    back = read_stereo(tmp_path / "left", tmp_path / "right")
    np.testing.assert_allclose(back.T_right_left, made.T_right_left, atol=1e-12)


def test_kalibr_pose_takes_the_camera_before_to_this_one(tmp_path):
    made = pair()
    [file] = write_stereo(tmp_path / "camchain.yaml", made)
    data = yaml.safe_load(file.read_text())
    np.testing.assert_array_equal(data["cam1"]["T_cn_cnm1"], made.T_right_left)
    assert "T_cn_cnm1" not in data["cam0"]
    assert (data["cam0"]["cam_overlaps"], data["cam1"]["cam_overlaps"]) == ([1], [0])


def test_opencv_reads_the_pair(tmp_path):
    made = pair()
    [file] = write_stereo(tmp_path / "stereo.yml", made)
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    got = {key: storage.getNode(key).mat() for key in ("M1", "D1", "M2", "D2", "R", "T", "R1", "R2", "P1", "P2", "Q")}
    np.testing.assert_array_equal(got["R"], made.T_right_left[:3, :3])
    np.testing.assert_array_equal(got["T"].ravel(), made.T_right_left[:3, 3])
    np.testing.assert_array_equal(got["Q"], made.rectification.Q)
    np.testing.assert_array_equal(got["P2"], made.rectification.P_right)
    assert got["D2"].shape == (4, 1)


def test_the_two_files_of_opencvs_stereo_sample(tmp_path):
    made = pair()
    parts = {"intrinsics": {"M1": made.left.K, "D1": np.zeros((1, 14)), "M2": made.right.K, "D2": np.zeros((1, 5))}}
    turns = made.rectification
    parts["extrinsics"] = {"R": made.T_right_left[:3, :3], "T": made.T_right_left[:3, 3:], "R1": turns.R_left}
    parts["extrinsics"] |= {"R2": turns.R_right, "P1": turns.P_left, "P2": turns.P_right, "Q": turns.Q}
    for part, values in parts.items():
        file = cv2.FileStorage(str(tmp_path / f"{part}.yml"), cv2.FILE_STORAGE_WRITE)
        for name, value in values.items():
            file.write(name, np.array(value))
        file.release()
    paths = tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"
    with pytest.raises(FormatError, match=r"'image_width'.*add the size"):
        read_stereo(*paths)
    paths[0].write_text(paths[0].read_text() + "image_width: 1280\nimage_height: 720\n")
    back = read_stereo(*paths)
    np.testing.assert_allclose(back.T_right_left, made.T_right_left, atol=1e-15)
    assert back.left.model == "pinhole"


@pytest.mark.parametrize("shift", [(-0.12, 0.004, 0.01), (0.003, -0.2, 0.01)], ids=["beside", "above"])
def test_ros_rectification_lines_the_pictures_up(tmp_path, shift):
    """What ROS will do with both files: rectified pixels of one point agree but for the disparity,
    and Q gives the point back."""
    made = pair("pinhole", shift=shift)
    files = write_stereo(tmp_path / "a", made, "ros")
    point = np.array([0.1, -0.2, 3.0])
    pixels = []
    for file, seen in zip(files, (point, made.T_right_left[:3, :3] @ point + made.T_right_left[:3, 3]), strict=True):
        data = yaml.safe_load(file.read_text())
        R = np.reshape(data["rectification_matrix"]["data"], (3, 3))
        P = np.reshape(data["projection_matrix"]["data"], (3, 4))
        x = P[:, :3] @ R @ seen  # the baseline is in the position of the camera already
        pixels.append(x[:2] / x[2])
    gap = pixels[0] - pixels[1]
    along = int(abs(shift[1]) > abs(shift[0]))
    assert abs(gap[1 - along]) < 1e-9
    turns = read_stereo(*files).rectification
    x = turns.Q @ [*pixels[0], gap[along], 1]
    np.testing.assert_allclose(x[:3] / x[3], turns.R_left @ point, atol=1e-9)


def test_pairs_that_are_none(tmp_path):
    for kind in ("ros", "mrcal", "opencv", "kalibr", "json"):
        write_camera(tmp_path / kind, camera("brown4"), kind)
    for paths, words in [
        (("ros", "ros"), "has no baseline"),
        (("ros", "opencv"), "one is ros, the other opencv"),
        (("opencv",), "holds 1 cameras, not a pair"),
        (("kalibr",), "holds 1 cameras, not a pair"),
        (("kalibr", "kalibr"), "one file"),
        (("json",), "holds 1 cameras, not a pair"),
        (("json", "json"), "one file"),
    ]:
        with pytest.raises(FormatError, match=words):
            read_stereo(*(tmp_path / p for p in paths))
    [file] = write_stereo(tmp_path / "camchain.yaml", pair())
    data = yaml.safe_load(file.read_text())
    data["cam1"]["T_cn_cnm1"][0][0] = 3.0
    file.write_text(yaml.dump(data))
    with pytest.raises(FormatError, match="no rotation"):
        read_stereo(file)
    with pytest.raises(RcdnError, match="T_right_left must be finite"):
        StereoCameras(camera(), camera(), np.eye(3))

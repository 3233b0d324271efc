"""Camera files as cv2.FileStorage writes them: arrays of one dimension, and XML."""

import cv2
import numpy as np
import pytest
from camera_files import SIZE, K, camera, same_camera

from rcdn.errors import FormatError
from rcdn.io import read_camera, read_rig, read_stereo


def written_by_opencv(path, **fields):
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {"image_width": SIZE[0], "image_height": SIZE[1], **fields}.items():
        file.write(name, value)
    file.release()
    return path


@pytest.mark.parametrize("ending", ["yaml", "xml"])
def test_arrays_of_one_dimension_are_read_as_opencv_writes_them(tmp_path, ending):
    """OpenCV 5 writes them as another kind than matrices."""
    lens = camera("brown5")
    fields = {"camera_matrix": K, "distortion_coefficients": lens.distortion}
    others = {"rvecs": np.zeros((3, 1, 3)), "errors": np.arange(3.0), "corners": np.zeros((2, 2, 2, 2), np.float32)}
    same_camera(read_camera(written_by_opencv(tmp_path / f"a.{ending}", **fields, **others)), lens)
    pair = {"M1": K, "D1": lens.distortion, "M2": K, "D2": lens.distortion[None], "R": np.eye(3)}
    found = read_stereo(written_by_opencv(tmp_path / f"b.{ending}", **pair, T=np.array([-0.1, 0, 0])))
    same_camera(found.right, lens)
    assert found.T_right_left.tolist() == [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]


@pytest.mark.parametrize("sizes", ["[ 4 ]", "[ -1 ]", "[ 5, 1, 1 ]", "[ ]", "5", "[ x ]"])
def test_an_array_of_other_sizes_than_its_numbers_is_refused(tmp_path, sizes):
    lens = camera("brown5")
    path = written_by_opencv(tmp_path / "a.yaml", camera_matrix=K, distortion_coefficients=lens.distortion[None])
    whole = path.read_text().replace("opencv-matrix\n   rows: 1\n   cols: 5", f"opencv-nd-matrix\n   sizes: {sizes}")
    path.write_text(whole)
    with pytest.raises(FormatError, match="'distortion_coefficients' must have one number in sizes, and as many"):
        read_camera(path)


@pytest.mark.parametrize("bits", [0, cv2.FILE_STORAGE_BASE64])
def test_xml_of_opencv_is_read(tmp_path, bits):
    d = np.array([[0.1, -0.2, 0.001, 0.002, 0.03]])
    R, T = cv2.Rodrigues(np.array([0.02, -0.3, 0.01]))[0], np.array([[-0.12], [0.004], [0.01]])

    def write(name, values):
        file = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE | bits)
        for key, value in values.items():
            file.write(key, value)
        file.startWriteStruct("images", cv2.FileNode_SEQ)
        file.write("", "left <01>.png")
        file.endWriteStruct()
        file.release()
        return tmp_path / name

    sides = {"calibration_time": "Mon & Tue", "image_width": 640, "image_height": 480, "avg_reprojection_error": 0.25}
    one = write("one.xml", {**sides, "camera_matrix": K, "distortion_coefficients": d})
    if bits:
        with pytest.raises(FormatError, match="must have rows, cols and as many numbers"):
            read_camera(one)
        return
    found = read_camera(one)
    assert found.K.tolist() == K.tolist()
    assert (found.distortion.tolist(), found.image_size) == (d[0].tolist(), (640, 480))
    pair = read_stereo(write("two.xml", {**sides, "M1": K, "D1": d, "M2": K, "D2": d, "R": R, "T": T}))
    np.testing.assert_array_equal(pair.T_right_left[:3], np.hstack([R, T]))
    assert read_rig(tmp_path / "two.xml").names == ("left", "right")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('<?xml version="1.0"?>\n<!DOCTYPE a [<!ENTITY b "bb">]>\n<opencv_storage>&b;</opencv_storage>', "a DOCTYPE"),
        ('<?xml version="1.0"?>\n<opencv_storage><camera_matrix>\n</opencv_storage>', "not XML .*line 3"),
        ('<?xml version="1.0" encoding="no"?>\n<opencv_storage></opencv_storage>', "not XML"),
        ('<?xml version="1.0"?>\n<opencv_storage><rows>3</rows></opencv_storage>', "image_width"),
        ("<opencv_storage>" + "<a>" * 100_000 + "</a>" * 100_000 + "</opencv_storage>", "image_width"),
        ("<html><body></body></html>", "no camera file that rcdn knows"),
    ],
    ids=["entities", "not closed", "encoding", "no camera", "deep", "of others"],
)
def test_other_xml_is_refused(tmp_path, text, words):
    path = tmp_path / "camera.xml"
    path.write_text(text)
    with pytest.raises(FormatError, match=words):
        read_camera(path)


def test_json_of_opencv_is_told_to_be_saved_as_yaml(tmp_path):
    path = tmp_path / "camera.json"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_FORMAT_JSON)
    file.write("camera_matrix", K)
    file.release()
    with pytest.raises(FormatError, match=r"not of rcdn; of OpenCV's FileStorage the YAML is read"):
        read_camera(path)

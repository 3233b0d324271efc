"""Pictures of coded boards: corners lie where OpenCV projects and reads them, with OpenCV's numbers; covers,
frames and light do what they say."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn.synthetic import Background, Cover, Scene, Sensor
from rcdn.targets.puzzle import CODE_1, CODE_2
from rcdn_lab.coded.drawings import aprilgrid_drawing, charuco_drawing, marker_count, puzzleboard_drawing
from rcdn_lab.coded.views import drawing_truth, posed, render_drawing

CODES = (CODE_1, CODE_2)
LENSES = {
    "pinhole": Scene(640, 480, 700.0, (319.5, 239.5)),
    "brown": Scene(640, 480, 600.0, (310.0, 250.0), model="brown", distortion=(-0.25, 0.06, 0.001, -0.001, 0.0)),
    "fisheye": Scene(640, 480, 320.0, (319.5, 239.5), model="fisheye", distortion=(0.0, 0.0, 0.0, 0.0)),
}


def view(drawing, lens="pinhole", box=(12, 12, 627, 467), tilt=0.5, roll=0.4, **more):
    scene = replace(LENSES[lens], sensor=Sensor(blur=0.6, noise=1.0), background=Background("plain", 2), **more)
    return replace(scene, boards=(posed(drawing, scene.camera, box, tilt, 0.7, roll),))


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("more", [{}, {"legacy": True}, {"first": 20, "ratio": 0.6}], ids=str)
def test_opencv_reads_charuco_boards_where_the_truth_is(lens, more):
    drawing = charuco_drawing(7, 6, "DICT_5X5_100", **more)
    scene = view(drawing, lens)
    known, image = drawing_truth(drawing, scene), render_drawing(drawing, scene)
    ids = more.get("first", 0) + np.arange(marker_count(7, 6, more.get("legacy", False)))
    board = cv2.aruco.CharucoBoard(
        (7, 6), 1.0, more.get("ratio", 0.75), cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100), ids
    )
    board.setLegacyPattern(more.get("legacy", False))
    xy, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    assert len(numbers) >= 28
    gap = xy.reshape(-1, 2) - known.xy[numbers.ravel()]
    assert np.abs(np.median(gap, axis=0)).max() < 0.03
    assert np.median(np.linalg.norm(gap, axis=1)) < 0.1
    assert np.linalg.norm(gap, axis=1).max() < 0.4
    assert known.visible.all()


@pytest.mark.parametrize("lens", ["pinhole", "brown"])
def test_the_truth_is_what_opencv_projects(lens):
    """Board points from the drawing's own geometry, through cv2.projectPoints."""
    drawing = charuco_drawing(8, 5, "DICT_4X4_50")
    scene = view(drawing, lens)
    spec, camera = scene.boards[0], scene.camera
    i, j = np.meshgrid(np.arange(1, 8), np.arange(1, 5))
    middle = (spec.cols - 1) / 2, (spec.rows - 1) / 2
    plane = np.stack([i - 4.0 + middle[0], j - 2.5 + middle[1]], axis=-1).reshape(-1, 2)
    points = np.column_stack([plane, np.zeros(len(plane))])
    k = np.array(scene.distortion) if scene.distortion else None
    xy, _ = cv2.projectPoints(points, np.array(spec.rvec), np.array(spec.tvec), camera.K, k)
    np.testing.assert_allclose(drawing_truth(drawing, scene).xy, xy.reshape(-1, 2), atol=1e-6)


@pytest.mark.parametrize("border", [1, 2])
@pytest.mark.parametrize("dictionary", ["DICT_APRILTAG_36h11", "DICT_APRILTAG_16h5"])
def test_opencv_reads_the_tags_of_aprilgrids_upside_down(border, dictionary):
    """Printed tags are turned by 180° against OpenCV's; tag 0 is at the bottom left,
    and its first corner there has the number 0."""
    drawing = aprilgrid_drawing(4, 3, dictionary, border, 0.3)
    scene = view(drawing)
    known, image = drawing_truth(drawing, scene), render_drawing(drawing, scene)
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits, parameters.cornerRefinementMethod = border, cv2.aruco.CORNER_REFINE_SUBPIX
    name = getattr(cv2.aruco, dictionary)
    quads, ids, _ = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(name), parameters).detectMarkers(image)
    assert len(ids) >= 11
    tag = ids.ravel()
    corner = 16 * (tag // 4) + 2 * (tag % 4)  # at the tag's bottom left: OpenCV's top right of the turned tag
    order = np.stack([corner + 1, corner, corner + 8, corner + 9], axis=1)
    gap = np.linalg.norm(np.array(quads).reshape(-1, 4, 2) - known.xy[order], axis=2)
    assert np.percentile(gap, 20) < 0.06  # many start some px away in the small squares, and stay there
    assert gap.max() < 0.3 * known.pitch.min()


def test_circles_of_puzzleboards_carry_the_code():
    drawing = puzzleboard_drawing(5, 4, (12, 30), CODES)
    assert drawing.ids[0] == 501 * 30 + 12
    assert drawing.ids[-1] == 501 * 33 + 16
    place = dict(zip(drawing.ids.tolist(), drawing.xy, strict=True))
    x, y = np.rint((place[501 * 31 + 13] + place[501 * 31 + 14]) / 2).astype(int)  # on an edge along x
    assert (drawing.image[y, x] == 255) == (CODE_2[13 % 3][31 % 167] == "1")
    x, y = np.rint((place[501 * 31 + 13] + place[501 * 32 + 13]) / 2).astype(int)
    assert (drawing.image[y, x] == 255) == (CODE_1[31 % 3][13 % 167] == "1")


def test_inverted_boards_are_inverted():
    plain, inverted = (charuco_drawing(5, 4, "DICT_4X4_50", inverted=flag).image for flag in (False, True))
    np.testing.assert_array_equal(inverted, 255 - plain)


def test_the_sheet_fills_its_box_and_no_more():
    drawing = charuco_drawing(9, 5, "DICT_4X4_50")
    for lens in LENSES:
        scene = replace(view(drawing, lens, box=(40, 30, 600, 450)), sensor=Sensor(blur=0, noise=0))
        paper = render_drawing(drawing, scene) != render_drawing(
            replace(drawing, image=255 - drawing.image), scene
        )  # all that the print covers
        rows, columns = (np.flatnonzero(paper.any(axis=k)) for k in (1, 0))
        box = np.array([columns[0], rows[0], columns[-1], rows[-1]])
        slack = box - [40, 30, 600, 450]
        assert (slack * [1, 1, -1, -1] >= -1).all()
        assert np.abs(slack).min() <= 2


def test_corners_outside_the_frame_and_below_covers_are_not_demanded():
    drawing = charuco_drawing(8, 6, "DICT_4X4_50")
    scene = view(drawing, tilt=0.0, roll=0.0)
    whole = drawing_truth(drawing, scene)
    assert whole.visible.all()
    x = float(whole.xy[:, 0].mean())
    covered = replace(scene, covers=(Cover(x, 240, 640, 240, 400, square=True),))
    np.testing.assert_array_equal(drawing_truth(drawing, covered).visible, whole.xy[:, 0] < x - whole.pitch / 4)
    cut = replace(scene, width=int(x))
    np.testing.assert_array_equal(drawing_truth(drawing, cut).visible, whole.xy[:, 0] <= int(x) - 5)
    np.testing.assert_array_equal(render_drawing(drawing, covered)[:, int(x) + 8 :].astype(int).std(axis=0) < 4, True)


def test_the_same_scene_gives_the_same_bytes():
    drawing = charuco_drawing(5, 4, "DICT_4X4_50")
    scene = view(drawing)
    np.testing.assert_array_equal(render_drawing(drawing, scene), render_drawing(drawing, scene))
    assert (render_drawing(drawing, scene) != render_drawing(drawing, replace(scene, seed=1))).any()

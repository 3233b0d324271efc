"""Coded boards in steep perspective, under lenses that bend their lines and with markers close to their corners, and
AprilGrids completed from their print: rendered pictures with known corners and numbers."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from coded_scene import aprilgrid, charuco

from rcdn import Detector
from rcdn.geometry import apply_homography
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor
from rcdn.targets.complete_tags import completed_tags
from rcdn.targets.projected_lattice import projected_board
from rcdn.targets.rectify import extrapolated
from rcdn.types import AprilGrid
from rcdn_lab.coded.scenes import made
from rcdn_lab.coded.views import drawing_truth, render_drawing

WIDTH, HEIGHT = 640, 480


def pictured(drawing, fisheye=0.0, tilt=0.3, share=0.8, noise=2.0, blur=0.6):
    """The drawing and its corners in a picture `share` of whose height it spans, through a lens of `fisheye` degrees
    across, equidistant (0: a pinhole)."""
    h, w = np.array(drawing.image.shape) / drawing.unit
    focal = WIDTH / np.radians(fisheye) if fisheye else 600.0
    lens = {"focal": focal, "model": "fisheye", "distortion": (0.0,) * 4} if fisheye else {"focal": focal}
    R = cv2.Rodrigues(np.array([tilt, 0.0, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, 0.2]))[0]
    reach = focal / np.tan(share * HEIGHT / 2 / focal) / focal if fisheye else 2 * focal / (share * HEIGHT)
    distance = max(h, w) / 2 * reach
    t = [0, 0, distance] - R @ [w / 2 - 1.5, h / 2 - 1.5, 0.0]
    board = BoardSpec(9, 7, tuple(cv2.Rodrigues(R)[0].ravel().tolist()), tuple(t.tolist()), black=0.1, white=0.9)
    scene = Scene(
        WIDTH, HEIGHT, centre=((WIDTH - 1) / 2, (HEIGHT - 1) / 2), boards=(board,), seed=1,
        sensor=Sensor(blur=blur, noise=noise), background=Background("noise", 1), **lens,
    )  # fmt: skip
    return render_drawing(drawing, scene), drawing_truth(drawing, scene).xy


def numbers(image, drawing, xy):
    """(corners with their right number, with a wrong one, corners in the picture)."""
    place = dict(zip(drawing.ids.tolist(), xy, strict=True))
    right = wrong = 0
    for board in Detector().boards(image):
        for number, at in zip([] if board.ids is None else board.ids.tolist(), board.xy, strict=board.ids is not None):
            good = number in place and np.linalg.norm(place[number] - at) < 2
            right, wrong = right + good, wrong + (not good)
    inside = ((xy > 2) & (xy < [WIDTH - 3, HEIGHT - 3])).all(axis=1)
    return right, wrong, int(inside.sum())


@pytest.mark.parametrize(
    "board",
    [
        charuco(7, 9, "DICT_APRILTAG_36h11", 0.66),
        charuco(5, 7, "DICT_6X6_50", 0.62),
        charuco(10, 4, "DICT_5X5_50", 0.7),
    ],
    ids=["7x9", "5x7", "10x4"],
)
def test_a_charuco_board_is_read_through_a_fisheye(board):
    """An odd number of columns is read only where the paper beside it is seen, which needs the lens in the lattice."""
    image, xy = pictured(board, fisheye=150)
    right, wrong, shown = numbers(image, board, xy)
    assert wrong == 0
    assert right == shown > 0.9 * len(xy)


def test_a_small_board_is_read_in_steep_perspective():
    """As above: beside three rows of corners at a tilt of 60°, lines must be continued in perspective."""
    scene = made("charuco ARUCO_MIP_36h12", "tilt 60", 4)
    (board,) = Detector().boards(scene.image)
    assert board.target == scene.board.target
    place = dict(zip(scene.board.ids.tolist(), scene.board.xy, strict=True))
    assert sorted(board.ids.tolist()) == sorted(place)
    assert np.linalg.norm(board.xy - [place[n] for n in board.ids.tolist()], axis=1).max() < 0.5


def test_squares_around_a_board_are_sampled_where_its_plane_is():
    """4 × 3 corners seen steeply; the pictures have the x and the y of their pixels as grey levels."""
    R = cv2.Rodrigues(np.array([0.3, 1.0, 0.2]))[0]
    H = np.array([[300.0, 0, 319.5], [0, 300, 239.5], [0, 0, 1]]) @ np.column_stack([R[:, :2], [-1.5, -1.5, 6.0]])
    known = apply_homography(H, np.stack(np.meshgrid(np.arange(4.0), np.arange(3.0)), axis=2))
    grid = extrapolated(np.pad(known, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan))
    lattice = projected_board(grid, np.pad(np.ones((3, 4), bool), 1), (WIDTH, HEIGHT))
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    seen = np.stack([lattice.rectified(grey, 8) for grey in (x, y)], axis=-1)
    row, column, v, u = np.indices((6, 7, 8, 8))
    true = apply_homography(H, np.stack([column - 2 + (u + 0.5) / 8, row - 2 + (v + 0.5) / 8], axis=-1))
    inside = ((true > 10) & (true < [WIDTH - 11, HEIGHT - 11])).all(axis=-1)
    assert inside[1:-1, 1:-1].all()
    assert np.linalg.norm(seen - true, axis=-1)[inside].max() < 0.01


@pytest.mark.parametrize("ratio", [0.8, 0.85])
@pytest.mark.parametrize("more", [{}, {"noise": 30.0}, {"blur": 2.5}, {"tilt": 0.6}, {"fisheye": 120.0}])
def test_markers_may_come_close_to_the_corners(ratio, more):
    """Rings of a third of the pitch then lie within the markers for most of their length."""
    board = charuco(7, 6, "DICT_4X4_50", ratio)
    image, xy = pictured(board, **more)
    assert numbers(image, board, xy) == (len(xy), 0, len(xy))


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("blur", [2.0, 2.5])
def test_a_blurred_board_that_begins_with_another_marker_is_read(inverted, blur):
    """Where the blur darkens the narrow white around the markers, the paper is brighter than any square."""
    board = charuco(8, 6, "DICT_4X4_50", 0.8, inverted=inverted, first=11)
    image, xy = pictured(board, blur=blur, noise=1.0)
    assert numbers(image, board, xy) == (len(xy), 0, len(xy))


@pytest.mark.parametrize("fisheye", [0.0, 150.0])
@pytest.mark.parametrize("share", [0.5, 0.9])
def test_every_corner_of_an_aprilgrid_is_found(fisheye, share):
    board = aprilgrid(5, 4)
    image, xy = pictured(board, fisheye, share=share)
    right, wrong, shown = numbers(image, board, xy)
    assert wrong == 0
    assert right == shown > 0.9 * len(xy)


def test_an_aprilgrid_seen_steeply_is_found():
    """Small squares are then some 3 px high, and the link graph joins rows by twos only."""
    board = aprilgrid(5, 5)
    image, xy = pictured(board, tilt=np.radians(60), share=0.8)
    right, wrong, shown = numbers(image, board, xy)
    assert wrong == 0
    assert right >= 0.95 * shown


@pytest.mark.parametrize("fisheye", [0.0, 150.0])
def test_corners_that_were_lost_come_back_and_strays_go(fisheye):
    drawing = aprilgrid(4, 4)
    image, xy = pictured(drawing, fisheye, share=0.7)
    board = Detector().boards(image)[0]
    assert isinstance(board.target, AprilGrid)
    assert len(board) == 64
    rng = np.random.default_rng(5)
    kept = np.sort(rng.choice(64, 44, replace=False))
    part = replace(
        board, xy=board.xy[kept], ij=board.ij[kept], response=board.response[kept], status=board.status[kept],
        sigma=board.sigma[kept], ids=board.ids[kept],
    )  # fmt: skip
    moved = part.xy.copy()
    moved[20] += 4.0
    found = completed_tags(image, replace(part, xy=moved), board.target)
    true = dict(zip(drawing.ids.tolist(), xy, strict=True))
    off = np.linalg.norm(found.xy - [true[n] for n in found.ids.tolist()], axis=1)
    assert off.max() < 1.0
    assert len(found) >= 62


def test_what_is_covered_is_not_made_up():
    drawing = aprilgrid(5, 4)
    image, xy = pictured(drawing)
    image = image.copy()
    low, high = np.quantile(xy, 0.35, axis=0).astype(int), np.quantile(xy, 0.7, axis=0).astype(int)
    image[low[1] : high[1], low[0] : high[0]] = 128
    hidden = ((xy > low + 2) & (xy < high - 2)).all(axis=1)
    assert hidden.sum() >= 5
    for board in Detector().boards(image):
        gap = np.linalg.norm(board.xy[:, None] - xy[None, hidden], axis=2).min()
        assert gap > 3


@pytest.mark.parametrize("share", [0.7, 0.8])
def test_a_blurred_aprilgrid_of_small_tags_is_read(share):
    """Its squares between tags are 3 to 4 px wide, its blur 2.5 px: half of the picture shows hardly anything of it."""
    board = aprilgrid(6, 5, gap=0.2)
    image, xy = pictured(board, share=share, blur=2.5)
    right, wrong, shown = numbers(image, board, xy)
    assert wrong == 0
    assert right == shown == len(xy)


@pytest.mark.parametrize("tilt", [1.0, 1.1])
def test_squares_of_which_a_marker_leaves_a_narrow_rim_are_linked_at_a_steep_tilt(tilt):
    board = charuco(8, 6, "DICT_4X4_50", 0.78)
    image, xy = pictured(board, tilt=tilt)
    right, wrong, shown = numbers(image, board, xy)
    assert wrong == 0
    assert right == shown == len(xy)


def test_parts_that_codes_complete_to_the_same_board_are_one_board():
    board = charuco(8, 6, "DICT_4X4_50", 0.74)
    image, xy = pictured(board, tilt=1.1)
    assert [len(found) for found in Detector().boards(image)] == [len(xy)]

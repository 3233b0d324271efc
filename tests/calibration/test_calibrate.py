"""Boards to a camera: known cameras come back within their deviations, and what can't be
calibrated is refused or said."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import cv2
import numpy as np
import pytest

from rcdn.calibration import calibrate
from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.calibrate import LENSES
from rcdn.calibration.solver import solve
from rcdn.calibration.usable import Usable, with_poses
from rcdn.errors import CalibrationError, ConfigError
from rcdn.geometry import project, rotation
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, board, labels, random_boards, random_pose, see
from rcdn_lab.real_boards import curved_board

BROWN = CAMERAS["brown"]
FISHEYE = Camera(
    np.array([[150.0, 0, 322], [0, 149, 241], [0, 0, 1]]), [0.02, -0.005, 0.001, -0.0002], (640, 480), "fisheye"
)


def around(camera, seed, views=14, half=100.0, noise=0.2):
    """Boards that face a camera from all sides, up to `half` degrees off its axis."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < views:
        off, side = np.radians(rng.uniform(0, half)), rng.uniform(-np.pi, np.pi)
        sight = np.array([np.sin(off) * np.cos(side), np.sin(off) * np.sin(side), np.cos(off)])
        R = rotation(np.array([-np.sin(side), np.cos(side), 0]) * off) @ rotation(np.append(rng.normal(0, 0.3, 2), 0))
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, sight * rng.uniform(0.2, 0.5) - R @ [0.12, 0.075, 0]
        ij, xy = see(camera, T)
        if len(ij) > 27:
            xy = xy + rng.normal(0, noise, xy.shape)
            out.append(board(ij - ij.min(axis=0), xy, camera.image_size, np.full(len(xy), noise)))
    return out


def facing(views, seed=0, nearer=0.0, noise=0.2):
    """Boards parallel to the sensor of a pinhole camera, at 0.5 m or `nearer` or farther."""
    rng, camera, out = np.random.default_rng(seed), CAMERAS["pinhole"], []
    while len(out) < views:
        T, z = np.eye(4), 0.5 + rng.uniform(-nearer, nearer)
        T[:3, 3] = [*rng.uniform(-0.3, 0.3, 2) * z - [0.12, 0.075], z]
        ij, xy = see(camera, T)
        if len(ij) == 54:
            out.append(board(ij, xy + rng.normal(0, noise, xy.shape), (640, 480), np.full(54, noise)))
    return out


def z_of(found, camera):
    return (found.camera.parameters - camera.parameters) / found.std


# ---- known cameras


@pytest.mark.parametrize("model", CAMERAS)
def test_known_cameras_come_back_within_their_deviations(model):
    """Parts among the views."""
    boards, poses = random_boards(CAMERAS[model], 11, 12)
    found = calibrate(boards, SPACING, model=model)
    if model != "rational":  # whose numbers make up for each other far beyond what a covariance can say
        assert np.abs(z_of(found, CAMERAS[model])).max() < 4
    assert found.rms < found.held_out < 1.25 * found.rms
    assert found.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.06)
    assert not found.left_out
    assert [v.name for v in found.views] == [f"board {k}" for k in range(12)]
    for b, v, T in zip(boards, found.views, poses, strict=True):
        assert np.array_equal(v.xy, b.xy)
        if len(b) == 54:
            assert v.settled
            assert pytest.approx(T[:3, :3], abs=0.03) == v.pose.R


def test_residuals_are_observed_minus_projected():
    """Seen on the board as it was found to be, where it is settled which corner is which."""
    boards, _ = random_boards(BROWN, 1, 8, outliers=0.05)
    found = calibrate(boards, SPACING, model="brown")
    assert len({v.settled for v in found.views}) == 2
    for v in found.views:
        on_board = np.column_stack([v.ij * SPACING, np.zeros(len(v))]) + (found.shape.at(v.ij) if v.settled else 0)
        points = on_board @ v.pose.R.T + v.pose.t
        assert v.residuals == pytest.approx(v.xy - project(found.camera, points), abs=1e-9)


@pytest.mark.parametrize("model", ["fisheye", "auto"])
def test_a_fisheye_beyond_ninety_degrees(model):
    boards = around(FISHEYE, 1, views=10)
    found = calibrate(boards, SPACING, model=model)
    assert found.camera.model == "fisheye"
    assert not found.left_out
    assert np.abs(z_of(found, FISHEYE)).max() < 4
    behind = [v.pose.R @ [0.12, 0.075, 0] + v.pose.t for v in found.views]
    assert min(p[2] for p in behind) < 0


@pytest.mark.parametrize("shift", [(120, -80), (-150, 60)])
def test_a_principal_point_far_off_the_middle(shift):
    K = BROWN.K + np.array([[0, 0, shift[0]], [0, 0, shift[1]], [0, 0, 0]])
    camera = replace(BROWN, K=K)
    found = calibrate(random_boards(camera, 2, 10)[0], SPACING, model="brown")
    assert np.abs(z_of(found, camera)).max() < 4


def test_a_long_lens():
    K = CAMERAS["pinhole"].K * np.array([[8, 1, 1], [1, 8, 1], [1, 1, 1]])
    camera, rng, boards = replace(CAMERAS["pinhole"], K=K), np.random.default_rng(0), []
    while len(boards) < 12:
        ij, xy = see(camera, random_pose(rng, 0.05, 0.8, (3, 7)))
        if len(ij) == 54:
            boards.append(board(ij, xy + rng.normal(0, 0.2, xy.shape), (640, 480)))
    found = calibrate(boards, SPACING, model="pinhole")
    assert np.abs(z_of(found, camera)).max() < 4
    assert found.camera.K[0, 0] == pytest.approx(K[0, 0], rel=0.03)


def test_radtan_has_four_numbers():
    camera = Camera(BROWN.K, [-0.28, 0.09, 0.001, -0.0015], (640, 480))
    found = calibrate(random_boards(camera, 4, 10)[0], SPACING, model="radtan")
    assert len(found.camera.distortion) == LENSES["radtan"][1] == 4
    assert np.abs(z_of(found, camera)).max() < 4


def test_several_boards_a_picture():
    """Boards of one name are numbered, and held out together."""
    boards, _ = random_boards(BROWN, 5, 12)
    names = [f"{k // 2}.png" for k in range(12)]
    found = calibrate(boards, SPACING, names=names, model="brown")
    assert [(v.name, v.board) for v in found.views] == [(f"{k // 2}.png", k % 2) for k in range(12)]
    assert np.abs(z_of(found, BROWN)).max() < 4
    assert found.held_out > found.rms


# ---- labels and shapes of boards


def test_turned_boards_are_the_same_board():
    """By the quarter that leaves the square inside (0, 0) its colour."""
    boards, _ = random_boards(BROWN, 6, 8, whole=True)
    turned = [
        replace(b, ij=np.stack([5 - b.ij[:, 1], b.ij[:, 0]], axis=-1)) if k % 3 == 0 else b
        for k, b in enumerate(boards)
    ]
    a, b = (calibrate(x, SPACING, model="brown") for x in (boards, turned))
    assert b.size == (9, 6)
    assert b.orientation == "unique"
    assert all(v.settled for v in b.views)
    assert b.camera.parameters == pytest.approx(a.camera.parameters, rel=1e-4, abs=1e-4)


def without_plane(depth):
    """`depth` (rows, columns) less the plane that fits it best."""
    rows, cols = depth.shape
    slopes = np.column_stack([np.ones(rows * cols), labels((cols, rows))])
    return depth.ravel() - slopes @ np.linalg.lstsq(slopes, depth.ravel(), rcond=None)[0]


def test_a_bend_is_found_and_predicts_better():
    domed = curved_board((0.003, -0.002))
    boards, _ = random_boards(BROWN, 3, 12, whole=True, offsets=domed)
    bent, flat = calibrate(boards, SPACING, model="brown"), calibrate(boards, SPACING, model="brown", flat=True)
    assert flat.shape is None
    depth, truth = bent.shape.offsets[:, :, 2], domed[:, 2].reshape(6, 9)
    assert np.abs(without_plane(depth) - without_plane(truth)).max() < 2e-4
    assert bent.shape.bend == pytest.approx(np.ptp(without_plane(truth)), abs=3e-4)
    assert bent.held_out < 0.6 * flat.held_out
    assert np.abs(z_of(bent, BROWN)).max() < 4


def test_views_that_do_not_settle_their_labels_tell_nothing_of_the_shape():
    """They serve the lens; a part of a perfect board, shifted by whole squares, makes no shape."""
    boards, _ = random_boards(BROWN, 3, 12, whole=True)
    part = boards[0]
    keep = part.ij[:, 0] < 6
    part = replace(
        part, ij=part.ij[keep], xy=part.xy[keep], sigma=part.sigma[keep], response=np.ones(36), status=np.zeros(36)
    )
    found = calibrate([part, *boards[1:]], SPACING, model="brown")
    assert not found.views[0].settled
    assert found.views[0].used.all()
    assert found.shape.bend < 2e-4
    assert np.abs(z_of(found, BROWN)).max() < 4


@pytest.mark.parametrize(("whole", "shaped"), [(5, True), (4, False)])
def test_a_shape_takes_five_settled_views(whole, shaped):
    x, y = (labels() / (np.array(SIZE) - 1) - 0.5).T
    bent = np.column_stack(
        [np.zeros((54, 2)), 0.004 * (x**2 + y**2)]
    )  # of a perfect board a shape may predict worse than none
    boards, _ = random_boards(BROWN, 3, whole, whole=True, offsets=bent)
    half = [b.ij[:, 0] < 5 for b in boards]
    parts = [board(b.ij[k], b.xy[k], b.image_size, b.sigma[k]) for b, k in zip(boards, half, strict=True)]
    found = calibrate([*boards, *parts[:3]], SPACING, model="brown")
    assert sum(v.settled for v in found.views) == whole
    assert (found.shape is not None) == shaped


@pytest.mark.parametrize("size", [(8, 6), (7, 7), (6, 6)])
def test_symmetric_boards_are_flagged(size):
    found = calibrate(random_boards(CAMERAS["pinhole"], 1, 6, size=size, whole=True)[0], SPACING, model="pinhole")
    assert found.size == size
    assert found.orientation == ("ambiguous_90" if size == (6, 6) else "ambiguous_180")
    assert any("looks the same" in text for text in found.advice)


def test_two_different_boards_help_and_are_said():
    a, _ = random_boards(BROWN, 3, 8, whole=True)
    b, _ = random_boards(BROWN, 4, 5, size=(11, 4), whole=True)
    found = calibrate([*a, *b], SPACING, model="brown")
    assert found.size == (9, 6)
    assert np.abs(z_of(found, BROWN)).max() < 4
    assert any("11×4" in text or "4×11" in text for text in found.advice)
    named = calibrate([*a, *b], SPACING, model="brown", size=(9, 6))
    assert [bool(v.reason) for v in named.views] == [False] * 8 + [True] * 5
    assert "11×4" in named.views[-1].reason


@pytest.mark.parametrize("size", [[9, 6], (9.0, 6.0), np.array([9, 6])])
def test_the_size_may_be_any_pair_of_whole_numbers(size):
    found = calibrate(random_boards(CAMERAS["pinhole"], 1, 4, whole=True)[0], SPACING, model="pinhole", size=size)
    assert found.size == (9, 6)
    assert all(type(n) is int for n in found.size)


def test_boards_of_another_size_alone():
    with pytest.raises(CalibrationError, match="can't be part of a 5×4 board"):
        calibrate(random_boards(BROWN, 3, 5, whole=True)[0], SPACING, size=(5, 4))


# ---- wrong input


@pytest.mark.parametrize("spacing", [0, -0.03, np.nan, np.inf])
def test_spacing_must_be_a_length(spacing):
    with pytest.raises(ConfigError, match="spacing"):
        calibrate(random_boards(BROWN, 0, 4)[0], spacing)


def test_a_huge_spacing_is_said():
    found = calibrate(random_boards(BROWN, 3, 10)[0], 25, model="brown")
    assert any("25 m" in text for text in found.advice)
    assert np.abs(z_of(found, BROWN)).max() < 4  # the lens doesn't mind


def test_wrong_arguments():
    boards = random_boards(BROWN, 0, 4)[0]
    with pytest.raises(ConfigError, match="model must be one of auto, pinhole"):
        calibrate(boards, SPACING, model="pinholes")
    with pytest.raises(ConfigError, match="names"):
        calibrate(boards, SPACING, names=["a"])


@pytest.mark.parametrize(("views", "text"), [(0, "no boards"), (1, "one view"), (2, "2 views")])
def test_too_few_views(views, text):
    with pytest.raises(CalibrationError, match=text):
        calibrate(random_boards(BROWN, 0, 3)[0][:views], SPACING)


@pytest.mark.parametrize(
    ("mirrored", "text"),
    [
        (1, "there are 2 views; 1 more can't be used, since its labels run the wrong way round, as if pixels were "),
        (2, "there is one view; 2 more can't be used, the first since its labels run the wrong way round, as "),
        (
            3,
            "there is no view that can be used; the first of 3 can't, since its labels run the wrong way round, as if ",
        ),
    ],
)
def test_too_few_views_are_told_in_whole_sentences(mirrored, text):
    boards = random_boards(BROWN, 0, 3)[0]
    turned = [replace(b, xy=[b.image_size[0] - 1, 0] + b.xy * [-1, 1]) for b in boards[:mirrored]]
    with pytest.raises(CalibrationError) as caught:
        calibrate(turned + boards[mirrored:], SPACING)
    assert str(caught.value).startswith(text)
    assert "mirrored after the corners were found. A camera takes 3 at least" in str(caught.value)


def test_views_without_a_pose_are_counted_with_those_that_cannot_be_used():
    reasons = {1: "its corners lie in one line"}
    task = Usable([0, 2, 3], [], reasons, None, np.zeros(0), np.zeros(0), 0)
    T = np.stack([np.eye(4), np.full((4, 4), np.nan), np.eye(4)])
    with pytest.raises(CalibrationError, match="2 views; 2 more can't be used, the first since its corners lie"):
        with_poses(task, T)
    with pytest.raises(CalibrationError, match="2 views; 1 more can't be used, since no pose fits its corners"):
        with_poses(replace(task, reasons={}), T)


@pytest.mark.parametrize(("nearer", "model"), [(0.0, "brown"), (0.15, "pinhole")])
def test_boards_that_all_face_the_camera_settle_nothing(nearer, model):
    with pytest.raises(CalibrationError, match="don't settle the focal length"):
        calibrate(facing(8, nearer=nearer), SPACING, model=model)


@pytest.mark.parametrize("model", ["pinhole", "brown", "auto"])
def test_one_view_again_and_again_is_refused_before_the_work(model, monkeypatch):
    monkeypatch.setattr(import_module("rcdn.calibration.calibrate"), "_fits", lambda *_, **__: pytest.fail("work"))
    first, rng = random_boards(BROWN, 3, 1)[0][0], np.random.default_rng(0)
    same = [replace(first, xy=first.xy + rng.normal(0, 0.2, first.xy.shape)) for _ in range(6)]
    with pytest.raises(CalibrationError, match="these 6 views all show the board in the same place"):
        calibrate(same, SPACING, model=model)


def test_pictures_of_several_sizes():
    boards, _ = random_boards(BROWN, 3, 8)
    odd = lambda b: replace(b, image_size=(320, 240))  # noqa: E731
    found = calibrate([odd(boards[0]), *boards[1:]], SPACING, model="brown")
    assert found.camera.image_size == (640, 480)
    assert found.views[0].reason == "its picture has 320×240 px, the others 640×480"
    assert np.isnan(found.views[0].residuals).all()
    with pytest.raises(CalibrationError, match=r"640×480 in 4: board 0, .*; 320×240 in 4: board 1, board 3"):
        calibrate([odd(b) if k % 2 else b for k, b in enumerate(boards)], SPACING)


def test_the_size_of_most_pictures_counts_and_not_that_of_most_boards():
    """A monitor's picture may show several boards."""
    boards, _ = random_boards(BROWN, 3, 8)
    many = [replace(boards[0], image_size=(320, 240), xy=boards[0].xy / 2 + k) for k in range(9)]
    names = [f"{k}.png" for k in range(8)] + ["odd.png"] * 9
    found = calibrate([*boards, *many], SPACING, names=names, model="brown")
    assert found.camera.image_size == (640, 480)
    assert [bool(v.reason) for v in found.views] == [False] * 8 + [True] * 9


def test_mirrored_labels_are_left_out_or_refused():
    boards, _ = random_boards(BROWN, 3, 8)
    flip = lambda b: replace(b, xy=b.xy * [-1, 1] + [639, 0])  # noqa: E731
    found = calibrate([flip(boards[0]), *boards[1:]], SPACING, model="brown")
    assert [k for k, v in enumerate(found.views) if v.reason] == [0]
    assert "mirrored" in found.views[0].reason
    with pytest.raises(CalibrationError, match="mirrored"):
        calibrate([flip(b) for b in boards], SPACING)


def test_some_corners_without_sigma():
    boards, _ = random_boards(BROWN, 3, 10)
    some = [replace(b, sigma=np.where(np.arange(len(b)) % 2, np.nan, 0.2)) for b in boards]
    found = calibrate(some, SPACING, model="brown")
    assert np.abs(z_of(found, BROWN)).max() < 4
    assert np.isnan(found.views[0].sigma[1])


def scrap(ij, xy):
    return board(np.array(ij), np.array(xy, float), (640, 480))


TINY = scrap([[0, 0], [1, 0], [0, 1]], [[5, 5], [9, 5], [5, 9]])
LINE = scrap([[k, 0] for k in range(8)], [[50 + 30 * k, 50 + 3 * k] for k in range(8)])
EMPTY = scrap(np.zeros((0, 2), int), np.zeros((0, 2)))
POINT = scrap(labels(), np.full((54, 2), 100.0))


@pytest.mark.parametrize(
    "bad",
    [TINY, LINE, EMPTY, POINT],
    ids=["tiny", "line", "empty", "point"],
)
def test_boards_that_tell_nothing_are_left_out_with_a_reason(bad):
    boards, _ = random_boards(BROWN, 3, 8)
    found = calibrate([*boards, bad], SPACING, model="brown")
    assert [bool(v.reason) for v in found.views] == [False] * 8 + [True]
    assert found.camera.parameters == pytest.approx(calibrate(boards, SPACING, model="brown").camera.parameters)


def test_positions_must_be_finite():
    boards, _ = random_boards(BROWN, 3, 5)
    xy = boards[0].xy.copy()
    xy[3] = np.nan
    with pytest.raises((ConfigError, CalibrationError), match="finite"):
        calibrate([replace(boards[0], xy=xy), *boards[1:]], SPACING)


def test_an_infinite_sigma_is_a_corner_that_tells_nothing():
    boards, _ = random_boards(BROWN, 3, 8)
    some = [replace(b, sigma=np.where(np.arange(len(b)) % 5, 0.2, np.inf)) for b in boards]
    assert np.abs(z_of(calibrate(some, SPACING, model="brown"), BROWN)).max() < 4


def test_exact_corners_give_the_exact_camera():
    found = calibrate(random_boards(BROWN, 3, 6, noise=0.0)[0], SPACING, model="brown")
    assert found.camera.parameters == pytest.approx(BROWN.parameters, rel=1e-5, abs=1e-5)
    assert found.rms < 1e-4


# ---- against least squares that believe every corner


def held_out_error(camera, boards):
    """RMS of other, exact boards with poses solved under `camera`."""
    frame = np.repeat(np.arange(len(boards)), [len(b) for b in boards])
    ij, xy = np.concatenate([b.ij for b in boards]), np.concatenate([b.xy for b in boards])
    corners = Corners3(frame, 0 * frame, ij * SPACING, xy, np.zeros((len(frame), 2)))
    _, poses = random_boards(BROWN, 77, len(boards), 0.0, whole=True)
    state = State.mono(camera, np.array(poses))
    done = solve(state, corners, np.ones(len(frame)), default_free(state, lens=False)).state
    return np.sqrt((residuals(done, corners) ** 2).sum(axis=1).mean())


def test_better_on_other_views_than_opencv_on_the_same_corners():
    """With 5 % gross errors and parts of boards."""
    boards, _ = random_boards(BROWN, 8, 15, outliers=0.05)
    found = calibrate(boards, SPACING, model="brown")
    points = [np.column_stack([b.ij * SPACING, np.zeros(len(b))]).astype(np.float32) for b in boards]
    _, K, lens, _, _ = cv2.calibrateCamera(points, [b.xy.astype(np.float32) for b in boards], (640, 480), None, None)
    others, _ = random_boards(BROWN, 77, 10, noise=0.0, whole=True)
    ours, theirs = held_out_error(found.camera, others), held_out_error(Camera(K, lens.ravel(), (640, 480)), others)
    assert ours < 0.05
    assert ours < 0.3 * theirs
    assert SIZE == (9, 6)

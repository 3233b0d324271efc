"""Where least squares begin: a rough camera and poses near enough for every lens, from few or hard views."""

from __future__ import annotations

import numpy as np
import pytest

from rcdn.calibration.start import Seen, first_camera, poses
from rcdn.geometry import project, rotation, unproject
from rcdn.types import Camera
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, random_boards, random_pose, see

WIDE_FISHEYE = Camera(
    np.array([[150.0, 0, 322], [0, 149, 241], [0, 0, 1]]), [0.02, -0.005, 0.001, -0.0002], (640, 480), "fisheye"
)


def seen_from(camera, seed, views=8, **pose):
    """(views, true poses) of whole boards with a little noise."""
    rng, out, truth = np.random.default_rng(seed), [], []
    while len(out) < views:
        T = random_pose(rng, **pose)
        ij, xy = see(camera, T)
        if len(ij) == SIZE[0] * SIZE[1]:
            out.append(Seen(ij * SPACING, xy + rng.normal(0, 0.1, xy.shape)))
            truth.append(T)
    return out, truth


def around(camera, seed, views=10, half=105.0):
    """Boards that face a camera from all sides, up to `half` degrees off its axis."""
    rng, out, truth = np.random.default_rng(seed), [], []
    while len(out) < views:
        off, side = np.radians(rng.uniform(0, half)), rng.uniform(-np.pi, np.pi)
        sight = np.array([np.sin(off) * np.cos(side), np.sin(off) * np.sin(side), np.cos(off)])
        turn = np.array([-np.sin(side), np.cos(side), 0]) * off
        R = (
            rotation(turn)
            @ rotation(np.append(rng.normal(0, 0.3, 2), 0))
            @ rotation(np.array([0, 0, rng.uniform(-3, 3)]))
        )
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, sight * rng.uniform(0.2, 0.4) - R @ [0.12, 0.075, 0]
        ij, xy = see(camera, T)
        if len(ij) == SIZE[0] * SIZE[1]:
            out.append(Seen(ij * SPACING, xy))
            truth.append(T)
    return out, truth


def angle(A, B):
    """Degrees between two rotations."""
    return np.degrees(np.arccos(np.clip((np.trace(A[:3, :3] @ B[:3, :3].T) - 1) / 2, -1, 1)))


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("views", [3, 10])
def test_focal_length_and_poses_are_near(model, views):
    camera = CAMERAS[model]
    seen, truth = seen_from(camera, 1, views)
    start = first_camera(seen, camera.image_size)
    assert start.K[0, 0] == pytest.approx(camera.K[0, 0], rel=0.3)
    found = poses(start, seen)
    assert max(angle(a, b) for a, b in zip(found, truth, strict=True)) < 20
    ratio = [a[2, 3] / b[2, 3] for a, b in zip(found, truth, strict=True)]
    assert 0.6 < min(ratio) <= max(ratio) < 1.6


@pytest.mark.parametrize("model", ["brown", "fisheye"])
@pytest.mark.parametrize("size", [(27, 39), (39, 40), (40, 40), (60, 79)])
def test_focal_length_is_near_whatever_the_number_of_corners(model, size):
    """Among corners that are spaced evenly over a list of 39 or 40 rows, nearly all are of one line."""
    camera, rng, seen = CAMERAS[model], np.random.default_rng(2), []
    ij = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
    on_board = ij * 8 * SPACING / max(size)
    while len(seen) < 8:
        T = random_pose(rng)
        xy = project(camera, np.column_stack([on_board, np.zeros(len(ij))]) @ T[:3, :3].T + T[:3, 3])
        if ((xy > 1) & (xy < np.array(camera.image_size) - 2)).all():
            seen.append(Seen(on_board, xy + rng.normal(0, 0.1, xy.shape)))
    assert first_camera(seen, camera.image_size).K[0, 0] == pytest.approx(camera.K[0, 0], rel=0.3)


@pytest.mark.parametrize("model", CAMERAS)
def test_poses_under_the_true_lens_are_exact(model):
    """Rays need no lens model of their own: exact corners give exact poses."""
    boards, truth = random_boards(CAMERAS[model], 2, views=5, noise=0.0, whole=True)
    found = poses(CAMERAS[model], [Seen(b.ij * SPACING, b.xy) for b in boards])
    assert found == pytest.approx(np.array(truth), abs=1e-6)


def test_poses_beside_and_behind_a_fisheye_are_exact():
    seen, truth = around(WIDE_FISHEYE, 0)
    assert any((T[:3, :3] @ [0.12, 0.075, 0] + T[:3, 3])[2] < 0 for T in truth)  # some stand behind the image plane
    assert poses(WIDE_FISHEYE, seen) == pytest.approx(np.array(truth), abs=1e-6)


def test_a_fisheye_beyond_ninety_degrees_gets_a_start_that_sees_there():
    seen, truth = around(WIDE_FISHEYE, 1)
    start = first_camera(seen, WIDE_FISHEYE.image_size)
    assert start.K[0, 0] == pytest.approx(150, rel=0.4)
    found = poses(start, seen)
    assert np.isfinite(found).all()
    assert np.median([angle(a, b) for a, b in zip(found, truth, strict=True)]) < 10


def test_a_long_lens():
    K = CAMERAS["pinhole"].K * np.array([[8, 1, 1], [1, 8, 1], [1, 1, 1]])
    camera = Camera(K, [], (640, 480), "pinhole")
    seen, _ = seen_from(camera, 0, 10, spread=0.04, distance=(3, 6))
    assert first_camera(seen, (640, 480)).K[0, 0] == pytest.approx(K[0, 0], rel=0.35)


def test_parts_of_different_sizes_do_not_disturb_each_other():
    """Views are padded to one length: each pose is that of its view alone."""
    camera = CAMERAS["brown"]
    seen, _ = seen_from(camera, 3, 4)
    seen[1] = Seen(seen[1].board[:20], seen[1].xy[:20])
    seen[2] = Seen(seen[2].board[:4] * [1, 1] + [[0, 0], [0, 0], [0, 0.03], [0, 0.03]], seen[2].xy[[0, 1, 11, 12]])
    together = poses(camera, seen)
    alone = np.concatenate([poses(camera, [s]) for s in seen])
    assert together == pytest.approx(alone, abs=1e-7)


def test_no_pose_where_the_lens_has_no_ray():
    camera = Camera(CAMERAS["brown"].K, [-0.5, 0, 0, 0, 0], (640, 480))  # folds at r = 0.82
    seen, _ = seen_from(camera, 0, 3)
    away = Seen(seen[0].board, seen[0].xy + 5000)
    found = poses(camera, [*seen, away])
    assert np.isfinite(found[:3]).all()
    assert np.isnan(found[3]).all()


def test_the_pose_is_that_of_the_least_algebraic_error():
    """Of noisy corners, some of which have no ray: that of the homography by a dense eigenvector (Zhang 2000)."""
    camera = Camera(CAMERAS["brown"].K, [-0.5, 0, 0, 0, 0], (640, 480))  # folds at r = 0.82
    (seen,), _ = seen_from(CAMERAS["brown"], 7, 1)
    noisy = seen.xy + np.random.default_rng(7).normal(0, 3, seen.xy.shape)
    noisy[::5] += 5000
    rays = unproject(camera, noisy)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    kept = np.isfinite(rays).all(axis=1)
    assert 4 < kept.sum() < len(kept)
    unit = (seen.board - seen.board.mean(axis=0)) / np.linalg.norm(seen.board - seen.board.mean(axis=0), axis=1).mean()
    X = np.column_stack([unit * np.sqrt(2), np.ones(len(unit))])
    rows = np.concatenate([np.kron(np.eye(3) - np.outer(r, r), x) for r, x in zip(rays[kept], X[kept], strict=True)])
    H = np.linalg.svd(rows)[2][-1].reshape(3, 3)
    H *= np.sign(((X[kept] @ H.T) * rays[kept]).sum())
    u, _, vt = np.linalg.svd(H[:, :2], full_matrices=False)
    (T,) = poses(camera, [Seen(seen.board, noisy)])
    assert T[:3, :2] == pytest.approx(u @ vt, abs=1e-9)
    assert T[:3, 2] == pytest.approx(np.cross(T[:3, 0], T[:3, 1]))
    assert T[3].tolist() == [0, 0, 0, 1]


@pytest.mark.parametrize("noise", [0.0, 0.1, 3.0])
def test_three_corners_and_corners_in_a_line_have_no_pose(noise):
    """Whatever the line's direction on the board and in the picture; next to it, six corners have one."""
    camera, rng = CAMERAS["brown"], np.random.default_rng(4)
    (whole,), _ = seen_from(camera, 0, 1)
    lines = [[0, 1, 11], [0, 1, 2, 3, 4, 5], [2, 11, 20, 29, 38], [0, 10, 20, 30, 40, 50], [8, 16, 24, 32]]
    near = [0, 1, 2, 9, 10, 11]
    xy = whole.xy + rng.normal(0, noise, whole.xy.shape)
    found = poses(camera, [*(Seen(whole.board[some], xy[some]) for some in lines), Seen(whole.board[near], xy[near])])
    assert np.isnan(found[:-1]).all()
    assert np.isfinite(found[-1]).all()


def test_boards_stand_in_front():
    camera = CAMERAS["pinhole"]
    seen, _ = seen_from(camera, 5, 10, distance=(1.0, 3.0))
    for view, T in zip(seen, poses(camera, seen), strict=True):
        points = np.column_stack([view.board, np.zeros(len(view.board))]) @ T[:3, :3].T + T[:3, 3]
        assert (points[:, 2] > 0).all()
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
        assert np.abs(project(camera, points) - view.xy).max() < 3

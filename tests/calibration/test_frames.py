"""Frames of rendered videos: sharp ones are taken, blurred and repeated ones are not, and views differ."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rcdn.batch.inputs import gather
from rcdn.calibration.frames import CANDIDATES, FrameSummary, candidates, choose_views, frame_summary
from rcdn.config import DetectorConfig
from rcdn.io import ImageResult, frames
from rcdn.io.images import frame_rate
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render
from rcdn.types import Board, Corners

POSES = [
    ((0.0, 0.0, 0.0), (0.0, 0.0), 12.0),
    ((0.5, 0.0, 0.0), (1.0, 1.0), 12.0),
    ((0.0, 0.5, 0.0), (-2.0, 0.0), 14.0),
    ((0.0, 0.0, 0.4), (3.0, -1.0), 16.0),
    ((-0.4, 0.3, 0.0), (-3.0, 1.5), 16.0),
    ((0.3, -0.4, 0.2), (2.0, 2.0), 11.0),
]


def picture(pose, seed, motion=0.0):
    """A board of 7 × 5 corners, 320 × 240 px; `motion` blur, px."""
    rvec, (x, y), z = pose
    board = BoardSpec(7, 5, rvec, (x - 3, y - 2, z))
    sensor = Sensor(motion=motion, motion_angle=0.3 * seed, noise=2)
    return render(
        Scene(
            320,
            240,
            300.0,
            (159.5, 119.5),
            boards=(board,),
            sensor=sensor,
            background=Background("noise", 3),
            seed=seed,
        )
    )


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A video that rests three times in each pose, and moves in between: (path, pose of each frame, blurred or not)."""
    path = tmp_path_factory.mktemp("video") / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (320, 240))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no video")
    poses, blurred = [], []
    for number, pose in enumerate(POSES):
        for k, motion in enumerate((7, 5, 0, 0, 0, 5, 7)):
            frame = picture(pose, 10 * number + k, motion)
            writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
            poses.append(number)
            blurred.append(motion > 0)
    writer.release()
    return path, np.array(poses), np.array(blurred)


def summaries(path):
    return [frame_summary(grey) for _, grey in frames(path)]


def test_candidates_are_sharp_and_every_pose_has_one(clip):
    path, poses, blurred = clip
    chosen = candidates(summaries(path))
    assert not blurred[chosen].any()
    assert poses[chosen].tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("most", [1, 2, 3, 4])
def test_fewer_candidates_are_of_different_poses(clip, most):
    path, poses, blurred = clip
    chosen = candidates(summaries(path), most)
    assert len(chosen) == most
    assert len(set(poses[chosen])) == most
    assert not blurred[chosen].any()


def test_candidates_are_a_function_of_the_video(clip):
    path, _, _ = clip
    assert candidates(summaries(path)) == candidates(summaries(path))


def test_a_still_video_has_one_candidate():
    still = [frame_summary(picture(POSES[0], seed)) for seed in range(8)]  # only the noise differs
    assert len(candidates(still)) == 1


def test_motion_lowers_the_energy_and_leaves_the_thumbnail():
    for pose in POSES:
        sharp, moved = frame_summary(picture(pose, 1)), frame_summary(picture(pose, 1, motion=6))
        assert moved.energy < 0.6 * sharp.energy
        assert np.abs(moved.small - sharp.small).mean() < 0.1 * sharp.small.mean()


def test_thumbnails_differ_the_more_the_further_the_board_moves():
    def moved(x):
        return frame_summary(picture(((0, 0, 0), (x, 0.0), 12.0), 1)).small

    gaps = [np.abs(moved(x) - moved(0.0)).mean() for x in (0.1, 0.4, 1.6, 3.2)]
    assert (np.diff(gaps) > 0).all()


def test_no_stretch_of_time_is_passed_over():
    """A wild part of a video doesn't take all candidates from the calm one."""
    rng = np.random.default_rng(0)
    wild = [FrameSummary(100.0, rng.random((12, 16)).astype(np.float32)) for _ in range(600)]
    calm = [FrameSummary(100.0, np.full((12, 16), 0.5, np.float32) + np.float32(k / 600)) for k in range(600)]
    chosen = candidates(wild + calm)
    assert len(chosen) == CANDIDATES
    assert sum(k >= 600 for k in chosen) >= 12


def test_frames_seconds_apart_are_not_judged_by_each_other():
    """A board far away has less contrast along lines of pixels than one that was near a second before."""
    rng = np.random.default_rng(0)
    lapse = [FrameSummary(energy, rng.random((12, 16)).astype(np.float32)) for energy in (90.0, 30.0, 100.0, 20.0) * 3]
    assert candidates(lapse, rate=1) == list(range(12))
    assert candidates(lapse, rate=3) == [k for k in range(12) if k % 2 == 0]  # a third of a second is one frame here
    assert candidates(lapse) == candidates(lapse, rate=30) == [k for k in range(12) if k % 2 == 0]


def test_pictures_taken_a_second_apart_are_all_used(tmp_path):
    """Every second board is far away, so that few of the frame's pixels are at edges."""
    path = tmp_path / "lapse.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 1, (320, 240))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no video")
    for number, (rvec, place, z) in enumerate(POSES):
        frame = picture((rvec, place, z * (2.5 if number % 2 else 1)), number)
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    got = gather([str(path)], DetectorConfig(), jobs=1)
    assert [i.path for i in got.images] == [f"{path}#{k:06d}" for k in range(6)]
    assert got.notes == (f"{path}: 6 frames are used, of 6 with a board, of 6 sharp and different ones, of 6",)


@pytest.mark.parametrize("rate", [1.0, 12.5, 30.0])
def test_the_rate_of_a_video_is_read_from_its_file(tmp_path, rate):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (64, 48))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no video")
    for _ in range(3):
        writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    assert frame_rate(path) == pytest.approx(rate)


@pytest.mark.parametrize(
    "grey", [np.zeros((120, 160), np.uint8), np.zeros((1, 1), np.uint8), np.ones((3, 900), np.float32)]
)
def test_frames_without_anything_are_no_error(grey):
    assert len(candidates([frame_summary(grey)] * 3)) == 1
    assert candidates([]) == []


# ---- views


def view(x=300.0, y=200.0, pitch=20.0, sigma=0.02, cols=6, rows=4, shear=0.0, turn=0):
    """A board around (x, y) in an image of 640 × 480."""
    ij = np.array([(i, j) for j in range(rows) for i in range(cols)])
    middle = (ij - [(cols - 1) / 2, (rows - 1) / 2]) * pitch
    xy = middle @ np.array([[1.0, shear], [0.0, 1.0]]) + [x, y]
    if turn:  # the same corners, counted from the opposite one
        ij = np.array([cols - 1, rows - 1]) - ij
        order = np.lexsort(ij.T)
        ij, xy = ij[order], xy[order]
    board = Board(xy, ij, (640, 480), np.ones(len(ij)), np.zeros(len(ij)), "unique", np.full(len(ij), sigma))
    return ImageResult("v", 640, 480, Corners(xy, board.response, board.status), (board,))


def empty():
    return ImageResult("v", 640, 480, Corners(np.zeros((0, 2)), [], []), ())


def test_images_without_a_board_are_left_out():
    assert choose_views([]) == []
    assert choose_views([empty(), empty()]) == []
    assert choose_views([empty(), view(), empty()]) == [1]


def test_views_of_the_same_place_count_once():
    assert choose_views([view(), view(x=301), view(turn=1), view(y=300), view(y=301)]) in ([0, 3], [0, 4])


@pytest.mark.parametrize("change", [{"x": 400}, {"y": 300}, {"pitch": 30.0}, {"shear": 0.3}])
def test_place_size_and_tilt_make_a_difference(change):
    assert choose_views([view(), view(**change), view()]) == [0, 1]


def test_views_are_spread_out():
    rng = np.random.default_rng(1)
    crowd = [view(x=300 + dx, y=200 + dy) for dx, dy in rng.uniform(-15, 15, (60, 2))]
    apart = [view(x=100), view(x=500), view(y=80), view(y=400), view(pitch=50.0)]
    chosen = choose_views(crowd + apart, 7)
    assert len(chosen) == 7
    assert set(range(60, 65)) <= set(chosen)
    assert chosen == sorted(chosen)


def test_of_equal_places_the_sharp_one_and_the_whole_one_is_taken():
    assert choose_views([view(x=300, sigma=0.06), view(x=300.5), view(x=299.5, sigma=0.04)], 1) == [1]
    assert choose_views([view(rows=3), view(), view(cols=4)], 1) == [1]


def test_blurred_views_are_left_out():
    sharp = [view(x=150 + 60 * k) for k in range(6)]
    assert choose_views([*sharp, view(y=400, sigma=0.2)]) == [0, 1, 2, 3, 4, 5]


def test_unknown_sigma_is_no_error():
    unknown = view(x=500, sigma=np.nan)
    assert choose_views([view(), unknown]) == [0, 1]
    assert choose_views([unknown]) == [0]

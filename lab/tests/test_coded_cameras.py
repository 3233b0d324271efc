"""Cameras from coded boards beside OpenCV's: the judge on simulated corners, whose answers are known."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rcdn.errors import RcdnError
from rcdn_lab.camera_scenes import CAMERAS
from rcdn_lab.coded_cameras import Known, Shot, compared, held_out, opencvs, ours, pictures_of

sys.path.append(str(Path(__file__).parents[2] / "tests" / "calibration"))
from coded_views import CHARUCO, coded_boards

CAMERA, SIDE = CAMERAS["brown"], 0.03


def shots(seed, views=10, worse=3.0, noise=0.1):
    """OpenCV's corners are the same with noise `worse` times as large."""
    exact, _ = coded_boards(CAMERA, CHARUCO, SIDE, seed, views, share=1, noise=0.0)
    rng = np.random.default_rng(seed)
    mine = [replace(b, xy=b.xy + rng.normal(0, noise, b.xy.shape)) for b in exact]
    theirs = [b.xy + rng.normal(0, worse * noise, b.xy.shape) for b in exact]
    return [Shot(f"{k}", b, b.ids, xy) for k, (b, xy) in enumerate(zip(mine, theirs, strict=True))]


def test_the_judge_of_the_true_camera_sees_the_noise_and_what_the_pose_takes():
    found = np.concatenate([held_out(s, Known(CAMERA), SIDE, own=True) for s in shots(0, 20)])
    rms = np.sqrt((found**2).sum(axis=1).mean())
    assert np.sqrt(2) * 0.1 < rms < 1.25 * np.sqrt(2) * 0.1  # the pose rests on about 24 other corners


def test_corners_with_three_times_the_noise_lose():
    row = compared(shots(1, 16), SIDE, seeds=1)
    assert row["failed"] == 0
    assert row["pictures"] == 16
    assert row["ratio"] == pytest.approx(1 / 3, abs=0.1)
    assert row["rcdn"] == pytest.approx(0.15, abs=0.05)


def test_both_solve_the_true_camera_from_good_corners():
    some = shots(2, 20, worse=1.0, noise=0.02)
    for known in (ours(some, SIDE), opencvs(some, SIDE)):
        assert np.abs(known.camera.parameters[:4] - CAMERA.parameters[:4]).max() < 1


def test_only_corners_that_both_found_count():
    (shot,) = shots(3, 1)
    part = replace(shot, ids=shot.ids[5:][::-1], xy=shot.xy[5:][::-1])
    assert len(part.common) == len(shot.ids) - 5
    assert held_out(part, Known(CAMERA), SIDE, own=False) == pytest.approx(
        held_out(replace(shot, ids=shot.ids[5:], xy=shot.xy[5:]), Known(CAMERA), SIDE, own=False), abs=1e-6
    )


def test_too_few_pictures_and_empty_folders_are_told(tmp_path):
    with pytest.raises(RcdnError, match="takes 8"):
        compared(shots(4, 3), SIDE, seeds=1)
    with pytest.raises(RcdnError, match="no folder of pictures"):
        pictures_of(tmp_path)

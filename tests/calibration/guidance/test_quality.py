"""Blur and exposure of a frame, against pictures whose blur and levels are known."""

import cv2
import numpy as np
import pytest

from rcdn.calibration.guidance.quality import quality
from rcdn_lab.camera_scenes import board, labels

PITCH, FINE = 24, 8
"""px of a square's side, and how many times finer the picture is drawn first"""


def picture(blur=0.0, motion=0.0, dark=40.0, bright=200.0):
    """Squares in the middle of a frame (240, 320), blurred by a Gaussian of `blur` px, and by `motion` px along x; and
    its board of 9 × 6 corners."""
    y, x = np.mgrid[0 : 240 * FINE, 0 : 320 * FINE] / FINE
    odd = (np.floor((x - 40.5) / PITCH) + np.floor((y - 40.5) / PITCH)) % 2
    fine = np.where(odd > 0, bright, dark).astype(np.float32)
    if motion:
        fine = cv2.blur(fine, (round(motion * FINE), 1))
    if blur:
        fine = cv2.GaussianBlur(fine, (0, 0), blur * FINE)
    grey = cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA)
    ij = labels()
    return grey.clip(0, 255).round().astype(np.uint8), board(ij, 40.0 + PITCH * (1 + ij), (320, 240))


@pytest.mark.parametrize("blur", [0.5, 1.0, 2.0, 3.0])
def test_blur_is_measured_in_pixels(blur):
    """The pixel's own width and the interpolation add to it: 0.3 to 0.4 px, as standard deviations."""
    assert quality(*picture(blur)).blur == pytest.approx(np.hypot(blur, 0.45), abs=0.12)


def test_motion_counts_in_the_direction_that_it_blurs():
    still, moved = quality(*picture(0.7)).blur, quality(*picture(0.7, motion=8)).blur
    assert moved > 2.4 > 1.2 > still


def test_contrast_and_overexposure():
    found = quality(*picture(0.7, dark=60, bright=110))
    assert found.contrast == pytest.approx(50, abs=2)
    assert found.clipped == 0
    assert quality(*picture(0.7, bright=400)).clipped == 1


def test_noise_is_not_taken_for_blur():
    grey, seen = picture(1.0)
    noisy = np.random.default_rng(1).normal(grey, 12).clip(0, 255).astype(np.uint8)
    assert quality(noisy, seen).blur == pytest.approx(quality(grey, seen).blur, rel=0.15)


def test_nothing_to_measure():
    grey, seen = picture()
    alone = board(seen.ij[:1], seen.xy[:1], seen.image_size)
    assert np.isnan(quality(grey, alone).blur)

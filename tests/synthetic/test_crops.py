"""Windows for training: what is a corner in them, what is neither, and clutter from photographs."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn.synthetic import ORDINARY, PRESETS, random_crop
from rcdn.synthetic.crops import busy_window

PHOTO = np.random.default_rng(1).integers(0, 256, (150, 200), np.uint8)


def board(contrast):
    """A picture full of 16 px squares whose two greys are `contrast` of the range apart;
    one white and one black patch set that range."""
    y, x = np.mgrid[:112, :112]
    image = 128 + (0.5 - ((x // 16 + y // 16) % 2)) * 255 * contrast
    image[:8, :8], image[-8:, -8:] = 0, 255
    return image.astype(np.uint8)


@pytest.mark.parametrize(("contrast", "seen"), [(1.0, True), (0.4, True), (0.2, False), (0.05, False)])
def test_faint_corners_are_neither_demanded_nor_forbidden(contrast, seen):
    """Half black, half white varies by half the contrast: 0.15 asks for 30 % and what blur takes."""
    from rcdn.synthetic.crops import _plain

    corners = np.array([[47.5, 47.5], [63.5, 79.5], [31.5, 63.5]])
    assert (_plain(board(contrast), corners, 0.15) == seen).all()


def test_faint_changes_kinds_only():
    for seed in range(12):
        image, labels = random_crop(seed, 96, ORDINARY)
        same, fewer = random_crop(seed, 96, replace(ORDINARY, faint=0.2))
        assert np.array_equal(image, same)
        assert np.array_equal(labels[:, :2], fewer[:, :2])
        assert (fewer[:, 2] <= labels[:, 2]).all()


def test_busy_windows_are_the_ones_with_detail():
    """A photograph that is flat but for one corner: more tries find that corner more often."""
    flat = np.full((400, 400), 90, np.uint8)
    flat[:120, :120] = np.random.default_rng(2).integers(0, 256, (120, 120))
    detail = [
        np.mean([
            np.abs(
                cv2.Laplacian(
                    cv2.GaussianBlur(busy_window(np.random.default_rng(s), 64, [flat], n), (0, 0), 2), cv2.CV_64F
                )
            ).mean()
            for s in range(40)
        ])
        for n in (1, 8)
    ]  # fmt: skip
    assert detail[1] > 1.5 * detail[0]


def test_windows_without_a_board_come_from_photographs_if_there_are_any():
    ranges = replace(ORDINARY, none_p=1.0, busy_p=1.0)
    image, labels = random_crop(3, 80, ranges, [PHOTO])
    assert image.shape == (80, 80)
    assert image.dtype == np.uint8
    assert labels.shape == (0, 3)
    assert np.array_equal(image, random_crop(3, 80, ranges, [PHOTO])[0])
    assert np.array_equal(random_crop(3, 80, ranges)[0], random_crop(3, 80, replace(ranges, busy_p=0.0))[0])


def test_the_presets_without_photographs_are_as_they_were():
    assert [name for name, ranges in PRESETS.items() if ranges.busy_p or ranges.faint] == [
        "paper",
        "paper-noise",
        "paper-wide",
    ]

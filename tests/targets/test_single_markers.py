"""Markers that stand alone are named where no board was found, and nothing else is."""

import cv2
import numpy as np
import pytest
from coded_scene import SQUARE, puzzleboard, seen
from typer.testing import CliRunner

from rcdn.cli import app
from rcdn.targets.single_markers import DICTIONARIES, single_markers


def scene(dictionary, ids, turned=0.0):
    """Markers side by side on a grey wall, tilted, blurred and noisy."""
    paper = np.full((480, 640), 225, np.uint8)
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    for k, number in enumerate(ids):
        x = 60 + 190 * k
        paper[150:310, x : x + 160] = cv2.aruco.generateImageMarker(known, number, 160)
    before = np.array([[0, 0], [640, 0], [640, 480], [0, 480]], np.float32)
    after = np.array([[30, 20], [600, 60], [560, 430], [60, 460]], np.float32)
    around = np.float32([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
    after = (after - (320, 240)) @ around * np.float32(0.9) + np.float32((320, 240))
    view = cv2.warpPerspective(
        paper, cv2.getPerspectiveTransform(before, after.astype(np.float32)), (640, 480), borderValue=150
    )
    noise = np.random.default_rng(len(ids)).normal(0, 4, view.shape)
    return np.clip(cv2.GaussianBlur(view, (0, 0), 1.0) + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("dictionary", [name for name in DICTIONARIES if hasattr(cv2.aruco, name)])
@pytest.mark.parametrize("turned", [0.0, 2.2])
def test_markers_are_named_with_their_numbers(dictionary, turned):
    assert single_markers(scene(dictionary, (7, 21), turned)) == (dictionary, (7, 21))


def test_one_tag_is_enough_and_one_marker_of_16_bits_is_not():
    assert single_markers(scene("DICT_APRILTAG_36h11", (3,))) == ("DICT_APRILTAG_36h11", (3,))
    assert single_markers(scene("DICT_4X4_50", (3,))) is None


def test_noise_squares_and_other_codes_are_no_markers():
    random = np.random.default_rng(5)
    coarse = np.kron(random.integers(0, 2, (30, 40)) * 255, np.ones((16, 16))).astype(np.uint8)
    checkers = np.kron(np.add.outer(np.arange(12), np.arange(16)) % 2 * 255, np.ones((SQUARE, SQUARE))).astype(np.uint8)
    for image in (coarse, checkers, random.integers(0, 256, (480, 640)).astype(np.uint8), np.zeros((9, 9), np.uint8)):
        assert single_markers(image) is None
    assert single_markers(seen(puzzleboard(9, 7, (20, 40)))[0]) is None


def test_both_commands_say_so(tmp_path):
    folder = tmp_path / "tags"
    folder.mkdir()
    cv2.imwrite(str(folder / "tag.png"), scene("DICT_APRILTAG_36h11", (3,)))
    (folder / "broken.png").write_bytes(b"no picture")
    told = "not supported: single markers"
    detected = CliRunner().invoke(app, ["detect", str(folder)])
    assert told in detected.stdout
    assert "1 marker of DICT_APRILTAG_36h11" in detected.stdout
    calibrated = CliRunner().invoke(app, ["calibrate", str(folder), "--spacing", "25mm"])
    assert calibrated.exit_code == 1
    assert told in calibrated.stderr


def test_a_picture_of_nothing_gets_no_such_hint(tmp_path):
    cv2.imwrite(str(tmp_path / "wall.png"), np.full((480, 640), 128, np.uint8))
    assert "markers" not in CliRunner().invoke(app, ["detect", str(tmp_path)]).stdout

"""Pictures of a few grey levels: boards in them are found as in the same ones with usual contrast."""

import numpy as np
import pytest

import rcdn
from rcdn.corners.faint import FAINT, HIGH, LOW, stretched
from rcdn.synthetic import Background, BoardSpec, Scene, Sensor, render, truth

SIZE = (640, 480)


def scene(seed=0):
    return Scene(
        *SIZE, 500, (319.5, 239.5), boards=(BoardSpec(9, 6, (0.3, -0.2, 0.2), (-3.8, -2.4, 15.0)),),
        sensor=Sensor(blur=0.7, noise=0.0), background=Background("clutter", 3), seed=seed,
    )  # fmt: skip


@pytest.fixture(scope="module")
def picture():
    return render(scene()).astype(float)


def whole(image):
    found = rcdn.Detector().detect(image).boards
    xy = truth(scene())[0].xy.reshape(-1, 2)
    gaps = [np.linalg.norm(board.xy[:, None] - xy, axis=2).min(axis=1).max() for board in found]
    assert len(found) == 1
    assert found[0].complete
    assert found[0].size == (9, 6)
    return max(gaps)


@pytest.mark.parametrize("levels", [2.0, 2.5, 3, 8, 14])
def test_a_board_of_few_grey_levels_is_found(picture, levels):
    noise = np.random.default_rng(int(levels)).normal(0, 0.3, picture.shape)
    assert whole(np.rint(100 + picture * levels / 255 + noise).astype(np.uint8)) < 0.6


@pytest.mark.parametrize("share", [0.03, 0.01, 0.005])
def test_a_lamp_in_16_bits_hides_no_board(picture, share):
    """The percentile to which 16 bits are stretched lies on the lamp."""
    deep = np.rint(picture / 255 * share * 65535).astype(np.uint16)
    deep[:40, :40] = 65535
    assert whole(deep) < 0.2


def test_a_float_picture_with_a_pixel_above_one(picture):
    high = np.float32(picture / 255)
    high[3, 3] = 1.0001
    assert whole(high) < 0.1


def test_usual_pictures_and_constant_ones_are_left_alone(picture):
    assert stretched(np.uint8(picture)) is None
    assert stretched(np.full((20, 20), 7, np.uint8)) is None
    few = np.uint8(np.tile(np.arange(0, FAINT + 2), (20, 1)))
    assert stretched(few) is None
    assert (stretched(few[:, :-1]).min(), stretched(few[:, :-1]).max()) == (LOW, HIGH)


def test_noise_shows_no_board():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        noise = np.rint(30 + rng.normal(0, 1 + seed % 3, SIZE[::-1]))
        assert rcdn.Detector().detect(np.clip(noise, 0, 255).astype(np.uint8)).boards == []

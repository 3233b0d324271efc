"""What the networks see doesn't depend on gain, offset or type."""

import numpy as np
import pytest

from rcdn.corners.normalise import FLOOR, WINDOW, normalise
from rcdn.errors import ConfigError


def local_contrast(grey):
    return normalise(grey, "local")


def minmax(grey):
    return normalise(grey, "minmax")


NOISE = np.random.default_rng(0).integers(60, 180, (90, 110)).astype(np.uint8)


def test_minmax_sends_the_percentiles_to_zero_and_one():
    ramp = np.tile(np.arange(50, 201, dtype=np.uint8), (151, 1))
    assert [minmax(ramp).min(), minmax(ramp).max()] == pytest.approx([0, 1])
    spoilt = ramp.copy()
    spoilt[0, :5], spoilt[1, :5] = 255, 0  # ten hot and dead pixels of 22,801
    assert minmax(spoilt)[2:] == pytest.approx(minmax(ramp)[2:])
    assert minmax(spoilt).max() > 1  # not clipped


@pytest.mark.parametrize(("gain", "offset"), [(1, 30), (2, -100), (0.5, 7)])
def test_minmax_forgets_gain_and_offset(gain, offset):
    changed = NOISE.astype(np.float32) * np.float32(gain) + np.float32(offset)
    assert minmax(changed) == pytest.approx(minmax(NOISE.astype(np.float32)), abs=1e-5)


def test_local_forgets_the_offset_and_nearly_the_gain():
    base = NOISE.astype(np.float32)
    z = local_contrast(base)
    assert local_contrast(base + 50) == pytest.approx(z, abs=1e-4)
    std = base.std()
    for gain in (0.2, 0.5, 4.0):
        changed = local_contrast(base * np.float32(gain))
        factor = gain * (std + FLOOR) / (gain * std + FLOOR)  # all that the floor does
        assert changed == pytest.approx(z * factor, rel=0.05, abs=1e-3)
    assert local_contrast(base * 1000) == pytest.approx(local_contrast(base * 4000), abs=3e-3)


def test_local_by_hand():
    y, x, half = 40, 50, WINDOW // 2
    window = NOISE[y - half : y + half + 1, x - half : x + half + 1].astype(float)
    assert local_contrast(NOISE)[y, x] == pytest.approx((NOISE[y, x] - window.mean()) / (window.std() + 6), abs=1e-5)
    padded = np.pad(NOISE.astype(float), half, mode="reflect")[:WINDOW, :WINDOW]
    assert local_contrast(NOISE)[0, 0] == pytest.approx((NOISE[0, 0] - padded.mean()) / (padded.std() + 6), abs=1e-5)


def test_local_is_local():
    changed = NOISE.copy()
    changed[:, 80:] = 255 - changed[:, 80:]
    assert np.array_equal(local_contrast(NOISE)[:, : 80 - WINDOW // 2], local_contrast(changed)[:, : 80 - WINDOW // 2])


@pytest.mark.parametrize("kind", ["minmax", "local"])
def test_a_flat_picture_is_zero(kind):
    for level in (0, 77, 255):
        assert normalise(np.full((40, 50), level, np.uint8), kind) == pytest.approx(0, abs=1e-4)
        assert normalise(np.full((40, 50), level, np.float32), kind) == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("kind", ["minmax", "local"])
def test_the_type_does_not_matter(kind):
    """Of a wide picture and of one whose percentiles fall on a step between two levels."""
    step = np.full((40, 50), 100, np.uint8)
    step[0, :3], step[1:, 40:] = 20, 200
    for picture in (NOISE, step):
        a, b = normalise(picture, kind), normalise(picture.astype(np.float32), kind)
        assert a.dtype == b.dtype == np.float32
        assert np.array_equal(a, b)


def test_the_type_does_not_matter_where_few_pixels_are_dark():
    """The 0.1 percentile falls between the second and the third darkest of 2000 pixels, which are 60 levels apart."""
    picture = np.full((40, 50), 150, np.uint8)
    picture[0, :2], picture[0, 2:20], picture[5:] = 20, 80, 200
    assert minmax(picture) == pytest.approx(minmax(picture.astype(np.float32)), abs=1e-6)


def test_unknown_kind():
    with pytest.raises(ConfigError, match="'global'"):
        normalise(NOISE, "global")

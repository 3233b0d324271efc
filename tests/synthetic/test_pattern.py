"""The printed sheet: exact averages over footprints, the ink, the colours, the rim."""

import numpy as np
import pytest

from rcdn.synthetic import BoardSpec
from rcdn.synthetic.pattern import sheet

POSE = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def at(spec, u, v, width=0.01):
    """Reflectance and coverage at points."""
    u, v = np.broadcast_arrays(np.asarray(u, np.float32), np.asarray(v, np.float32))
    w = np.full(u.shape, width, np.float32)
    return sheet(spec, u, v, w, w)


def plain(cols=9, rows=9, **spec):
    return BoardSpec(cols, rows, *POSE, **({"black": 0.0, "white": 1.0} | spec))


def cells(n=200, squares=2):
    """A grid of `n`² points over `squares`² squares, from (1, 1) on."""
    return np.meshgrid(*2 * [1 + (np.arange(n) + 0.5) / n * squares])


def test_square_at_the_origin_is_dark():
    """The one at the top left too; neighbours alternate; `swap` exchanges them; grey is between black and white."""
    u, v = np.meshgrid(np.arange(10) - 0.5, np.arange(10) - 0.5)
    value, cover = at(plain(black=0.1, white=0.8), u, v)
    dark = (np.floor(u) + np.floor(v)) % 2 == 0
    assert np.abs(value - np.where(dark, 0.1, 0.8)).max() < 1e-4
    assert np.abs(cover - 1).max() < 1e-4
    assert value[0, 0] == pytest.approx(0.1, abs=1e-4)
    swapped = at(plain(black=0.1, white=0.8, swap=True), u, v)[0]
    assert np.abs(swapped + value - 0.9).max() < 1e-4


@pytest.mark.parametrize("width", [1e-3, 0.05, 0.3, 2.0])
def test_a_full_period_is_half_black(width):
    assert at(plain(), *cells(), width)[0].mean() == pytest.approx(0.5, abs=1e-3)
    assert at(plain(), 4.3, 4.6, 2.0)[0] == pytest.approx(0.5, abs=1e-5)  # one footprint, exactly


@pytest.mark.parametrize(("u", "width"), [(3.2, 0.1), (3.02, 0.1), (4.0, 0.3), (4.4, 1.7), (3.9, 3.1)])
def test_a_footprint_is_the_mean_of_its_points(u, width):
    points = u + ((np.arange(4000) + 0.5) / 4000 - 0.5) * width
    fine = (np.floor(points) % 2 != 0).mean()  # white in the row of v = 4.5
    ours = sheet(plain(), *(np.array([v], np.float32) for v in (u, 4.5, width, 1e-3)))[0][0]
    assert ours == pytest.approx(fine, abs=1e-3)


@pytest.mark.parametrize(
    "bleed",
    [
        0.0, 0.02, 0.06,
        -0.03,
        -0.06,
    ],
)  # fmt: skip
def test_ink_runs_evenly(bleed):
    """Black squares of side 1 − 2·bleed about their middles; where two of them overlap, the union."""
    u, v = cells()
    side = 1 - 2 * bleed
    gap = [np.abs((w - 0.5 - k + 1) % 2 - 1) for w in (u, v) for k in (0, 1)]  # to the nearest middle, even and odd
    dark = ((gap[0] < side / 2) & (gap[2] < side / 2)) | ((gap[1] < side / 2) & (gap[3] < side / 2))
    value = at(plain(bleed=bleed), u, v)[0]
    assert np.abs(value - 1 + dark).mean() < 0.01
    assert 1 - value.mean() == pytest.approx(side**2 / 2 - max(0.0, -2 * bleed) ** 2, abs=3e-3)


def test_margin_and_rim():
    """Printed squares reach from −1 to `cols`, the sheet `margin` further."""
    spec = plain(4, 3, margin=0.5, margin_value=0.4)
    value, cover = at(spec, [-1.6, -1.4, -0.9, 3.9, 4.4, 4.6], 0.5)
    assert cover == pytest.approx([0, 1, 1, 1, 1, 0], abs=1e-4)
    assert value[[1, 4]] == pytest.approx(0.4, abs=1e-4)
    assert at(spec, 0.5, [-1.6, -1.4, 3.4, 3.6])[1] == pytest.approx([0, 1, 1, 0], abs=1e-4)
    assert at(spec, -1.5, 0.5, 0.2)[1] == pytest.approx(0.5, abs=1e-6)  # half of a footprint on the rim


def test_painted_square_is_the_one_that_ends_at_its_corner():
    value = at(plain(painted=((2, 3, 0.37),)), [1.5, 0.5, 2.5, 1.5], [2.5, 2.5, 2.5, 3.5])[0]
    assert value[0] == pytest.approx(0.37, abs=1e-4)
    assert np.abs(value[1:]).max() < 1e-4  # dark as ever


def test_markers_stay_inside_white_squares():
    u, v = cells()
    bare, coded = at(plain(), u, v)[0], at(plain(coded=4), u, v)[0]
    dark = (np.floor(u) + np.floor(v)) % 2 == 0
    rim = np.maximum(np.abs(u % 1 - 0.5), np.abs(v % 1 - 0.5))
    assert (coded[dark & (rim < 0.49)] < 1e-4).all()
    assert (bare[~dark & (rim < 0.49)] > 0.9999).all()
    assert (coded[~dark & (rim > 0.36) & (rim < 0.49)] > 0.9999).all()
    assert (coded[~dark & (rim < 0.34) & (rim > 0.25)] < 1e-4).all()  # the frame
    inner = coded[~dark & (rim < 0.22)]
    assert 0.1 < inner.mean() < 0.9

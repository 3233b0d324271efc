"""The printed sheet: exact averages over footprints, the ink, the colours, the rim."""

import numpy as np
import pytest

from rcdn.synthetic import BoardSpec
from rcdn.synthetic.pattern import F32, sheet

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


# ---- the kernel computes what these say, bit by bit


def pulsed(u, width, duty):
    """Share of a footprint inside [2n + (1−duty)/2, 2n + (1+duty)/2], n any integer."""

    def integral(x):
        x = x - F32((1 - duty) / 2)
        n = np.floor(x * F32(0.5))
        return n * F32(duty) + np.clip(x - 2 * n, 0, F32(duty))

    return (integral(u + width * F32(0.5)) - integral(u - width * F32(0.5))) / width


def within(u, width, low, high):
    a, b = np.maximum(u - width * F32(0.5), F32(low)), np.minimum(u + width * F32(0.5), F32(high))
    return np.maximum(b - a, 0) / width


def inked(spec, u, v):
    """Where markers have ink: a border, and modules by a hash of their place."""
    n = spec.coded + 2
    cells = [np.floor(w).astype(np.int64) for w in (u, v)]
    modules = [np.floor((w - np.floor(w) - F32(0.15)) / F32(0.7) * n).astype(np.int64) for w in (u, v)]
    at_border = np.any([(m == 0) | (m == n - 1) for m in modules], axis=0)
    key = np.zeros(u.shape, np.int64)
    for part, factor in zip(cells + modules, (73856093, 19349663, 83492791, 49979693), strict=True):
        key ^= part * factor
    white = ((key * 2654435761) >> 13) & 1
    return np.all([(m >= 0) & (m < n) for m in modules], axis=0) & (at_border | (white == 0))


def printed(spec, u, v, wu, wv):
    duty = 1 - 2 * spec.bleed
    odd, even = ([pulsed(w + k, width, duty) for w, width in ((u, wu), (v, wv))] for k in (0, 1))
    dark = odd[0] * even[1] + even[0] * odd[1] if spec.swap else odd[0] * odd[1] + even[0] * even[1]
    dark = np.clip(dark, 0, 1)
    value = F32(spec.white) + F32(spec.black - spec.white) * dark
    if spec.coded:
        value = np.where(inked(spec, u, v) & (dark < 0.5), F32(spec.black), value)
    for i, j, paint in spec.painted:
        share = within(u, wu, i - 1, i) * within(v, wv, j - 1, j)
        value = value * (1 - share) + F32(paint) * share
    inside = within(u, wu, -1, spec.cols) * within(v, wv, -1, spec.rows)
    value = value * inside + F32(spec.margin_value) * (1 - inside)
    m = spec.margin
    return value, within(u, wu, -1 - m, spec.cols + m) * within(v, wv, -1 - m, spec.rows + m)


@pytest.mark.parametrize("seed", range(40))
def test_the_kernel_gives_these_bytes(seed):
    rng = np.random.default_rng(seed)
    spec = plain(
        int(rng.integers(2, 12)), int(rng.integers(2, 12)), black=rng.uniform(), white=rng.uniform(),
        margin=rng.uniform(0, 2), margin_value=rng.uniform(), swap=bool(rng.integers(2)), bleed=rng.uniform(-0.3, 0.3),
        coded=int(rng.integers(7)), painted=tuple(map(tuple, rng.uniform(0, 6, (rng.integers(4), 3)).tolist())),
    )  # fmt: skip
    u, v = rng.uniform(-5, 15, (2, 40, 31)).astype(F32)
    wu, wv = (10 ** rng.uniform(-6, 0.7, (2, 40, 31))).astype(F32)
    for ours, theirs in zip(sheet(spec, u, v, wu, wv), printed(spec, u, v, wu, wv), strict=True):
        np.testing.assert_array_equal(ours, theirs)

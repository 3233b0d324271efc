"""The paper's single corners: exact areas, the exact corner, angles, noise."""

import numpy as np
import pytest

from rcdn_lab.paper.corner_pictures import (  # fmt: skip
    BETWEEN,
    BRIGHT,
    DARK,
    View,
    corner_xy,
    crossing_angle,
    defocused,
    exposure,
    noisy,
    pattern_axes,
    pre_blurred,
)

MIDDLE = (DARK + BRIGHT) / 2


def sampled(view, size, fine):
    """The mean of the pattern over each pixel by fine² samples."""
    x, y = corner_xy(view, size)
    at = (np.arange(size)[:, None] + (np.arange(fine) + 0.5) / fine - 0.5).ravel()
    px, py = np.meshgrid(at - x, at - y)
    (a, b), (c, d) = pattern_axes(view)
    u, v = a * px + b * py, c * px + d * py
    grey = np.where(u * v > 0, BRIGHT, DARK)
    if view.gap:
        grey[(np.abs(u) <= view.gap / 2) | (np.abs(v) <= view.gap / 2)] = BETWEEN
    return grey.reshape(size, fine, size, fine).mean(axis=(1, 3))


def test_the_papers_corner_is_four_squares_with_a_row_and_a_column_between():
    grey = exposure(View(gap=1.0), 81)
    assert grey[:40, :40] == pytest.approx(BRIGHT, abs=1e-4)
    assert grey[41:, :40] == pytest.approx(DARK, abs=1e-4)
    assert np.rint(grey[40]) == pytest.approx(BETWEEN)
    assert np.rint(grey[:, 40]) == pytest.approx(BETWEEN)
    assert set(np.unique(np.rint(grey))) == {DARK, BETWEEN, BRIGHT}


@pytest.mark.parametrize("gap", [0.0, 1.0])
@pytest.mark.parametrize(
    ("rotation", "tilt", "x", "y"), [(23, 40, 0.2, -0.3), (45, 70, 0, 0), (88, 5, -0.49, 0.49), (10, 0, 0, 0.1)]
)
def test_pixels_are_means_over_their_area(rotation, tilt, x, y, gap):
    view = View(rotation, tilt, x, y, gap)
    assert (
        np.abs(exposure(view, 24) - sampled(view, 24, 80)).max() < 0.3
    )  # 80² samples a pixel err by 127 ÷ 80 ÷ 2 at worst


@pytest.mark.parametrize("share", [0.1, 0.25, -0.4])
def test_an_edge_along_the_pixels_covers_a_share_of_them(share):
    """Where any grid of samples would take steps."""
    grey = exposure(View(x=share), 21)
    assert grey[2, 10] == pytest.approx(MIDDLE + share * (BRIGHT - DARK), abs=1e-3)
    assert grey[18, 10] == pytest.approx(MIDDLE - share * (BRIGHT - DARK), abs=1e-3)


@pytest.mark.parametrize("blur", ["none", "pre-blur", "defocus"])
@pytest.mark.parametrize("angles", [(0, 0), (17, 0), (45, 0), (0, 35), (10, 70)])
def test_the_corner_is_the_centre_of_symmetry(angles, blur):
    """Half a turn about it maps the picture into itself."""
    view = View(*angles, gap=1.0)
    grey = defocused(view, 41, 1.3) if blur == "defocus" else exposure(view, 41)
    grey = pre_blurred(grey) if blur == "pre-blur" else grey
    assert np.abs(grey - grey[::-1, ::-1]).max() < 1e-4


def test_a_shifted_corner_is_where_it_is_said_to_be():
    """An edge's place is its grey levels' sum: of the row above and of the one below the corner, left and right."""
    view = View(x=0.31, y=-0.42)
    grey, (x, y) = exposure(view, 40), corner_xy(view, 40)
    bright = (grey[0] - DARK).sum() / (BRIGHT - DARK)  # pixels from the left that are bright
    below = (grey[:, 0] - DARK).sum() / (BRIGHT - DARK)
    assert bright - 0.5 == pytest.approx(x, abs=1e-4)
    assert below - 0.5 == pytest.approx(y, abs=1e-4)


@pytest.mark.parametrize("rotation", [0, 5, 30])
def test_a_quarter_turn_maps_pictures_into_one_another(rotation):
    one, two = (exposure(View(r, 0, gap=1.0), 33) for r in (rotation, rotation + 90))
    assert np.abs(np.rot90(one, -1) - two).max() < 1e-4  # np.rot90 by -1 turns x towards y, which is down


@pytest.mark.parametrize("tilt", [0, 30, 60, 70])
def test_tilt_gives_the_stated_crossing_angle(tilt):
    """Read off the picture: the share of a circle that is of one colour."""
    grey = exposure(View(tilt=tilt), 401)
    y, x = np.mgrid[-200:201, -200:201]
    disc = np.hypot(x, y) <= 199.5
    dark = (BRIGHT - grey[disc]).sum() / (BRIGHT - DARK) / disc.sum() * 180
    assert min(dark, 180 - dark) == pytest.approx(crossing_angle(tilt), abs=0.2)
    assert crossing_angle(70) == pytest.approx(37.8, abs=0.1)


def test_the_pre_blur_is_the_papers():
    dot = np.zeros((5, 5))
    dot[2, 2] = 1
    assert pre_blurred(dot)[2] == pytest.approx(0.512 * np.array([0, 0.244, 0.512, 0.244, 0]), abs=6e-4)


def test_defocus_has_the_spread_that_was_asked_for_up_to_the_border():
    grey = defocused(View(x=0.3), 61, 3.0)
    slope = -np.diff(grey[0]) / (BRIGHT - DARK)  # along a row far from the corner: the line spread of the blurred edge
    at = np.arange(60) + 0.5
    mean = (slope * at).sum() / slope.sum()
    assert slope.sum() == pytest.approx(1, abs=1e-3)
    assert mean == pytest.approx(30.3, abs=1e-3)
    assert (slope * (at - mean) ** 2).sum() == pytest.approx(9 + 1 / 6, abs=0.03)  # and two pixels' widths: 2 ÷ 12


@pytest.mark.parametrize("sigma", [2, 10, 20])
def test_noise_has_the_deviation_that_was_asked_for(sigma):
    """On grey levels that aren't cut."""
    noise = noisy(np.full((300, 300), MIDDLE), sigma, np.random.default_rng(1)) - MIDDLE
    assert noise.mean() == pytest.approx(0, abs=0.02 * sigma)
    assert noise.std() == pytest.approx(np.hypot(sigma, 1 / np.sqrt(12)), rel=0.01)


def test_strong_noise_is_cut_to_the_range():
    grey = noisy(np.full((100, 100), BRIGHT), 100, np.random.default_rng(1))
    assert grey.dtype == np.uint8
    assert (grey == 255).mean() == pytest.approx(0.2625, abs=0.02)  # chance of more than 63.5 above, of a normal

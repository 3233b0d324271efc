"""The sieve: X-corners pass whatever they look like, flat areas and edges don't."""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from corner_scene import board, checkerboard, render

from rcdn.config import DetectorConfig
from rcdn.corners import find_maxima
from rcdn.corners.response import load_model
from rcdn.corners.sieve import (
    CELL,
    STEEP_FLOOR,
    STEEP_FLOOR_BESIDE,
    cells_with_saddles,
    every_cell,
    saddles_by_steepness,
)


def passed(grey, xy, reach=1):
    """(N,) bool: is every cell marked that has a pixel within `reach` px of the positions `xy` (N, 2)?"""
    cells = cells_with_saddles(grey)
    step = np.arange(-reach, reach + 1)
    around = np.rint(xy).astype(int)[:, None] + np.stack(np.meshgrid(step, step), axis=-1).reshape(1, -1, 2)
    x, y = np.clip(around, 0, np.array(grey.shape[::-1]) - 1).transpose(2, 0, 1) // CELL
    return cells[y, x].all(axis=1)


def corner_at(xy, turn, size, blur=1.0, **grey):
    """A lone X-corner at `xy` px in a picture (H, W); its edges cross at right angles."""
    H = np.array([[np.cos(turn), -np.sin(turn), xy[0]], [np.sin(turn), np.cos(turn), xy[1]], [0, 0, 0.001]])
    H[:2, :2] *= 1000  # squares beyond any picture
    H[:2, 2] *= 0.001
    return render(checkerboard(H), size, blur, **grey)


def inner(cells):
    """All but the rim of two cells: the picture is continued by reflection,
    which makes kinks of edges that meet its border askew."""
    return cells[2:-2, 2:-2]


def half_plane(turn, size, blur, **grey):
    normal = np.array([np.cos(turn), np.sin(turn)])
    return render(lambda xy: (xy - np.array(size[::-1]) / 2) @ normal > 0.3, size, blur, **grey)


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
@pytest.mark.parametrize(
    ("pitch", "blur"),
    [(6, 0.5), (6, 1.0), (6, 1.5), (8, 1.5), (10, 2.0), (14, 3.0), (20, 4.0), (30, 4.0), (60, 0.5), (60, 4.0)],
)
def test_corners_of_all_sizes_tilts_and_blurs_pass(pitch, blur, kind):
    for seed, (tilt, noise) in enumerate([(0.0, 0), (0.3, 3), (0.6, 0), (0.6, 5), (0.4, 20)]):
        grey, truth, _ = board(pitch, tilt, 0.2 + seed, blur, noise, seed, size=(151, 163))
        assert len(truth) > 3
        assert passed(grey.astype(kind), truth).all(), (tilt, noise)


@pytest.mark.parametrize("contrast", [12, 18, 30])
def test_faint_corners_pass(contrast):
    for pitch, noise in [(8, 0), (8, 1), (20, 1), (20, 2)]:
        low = 128 - contrast / 2
        grey, truth, _ = board(pitch, 0.3, 0.3, 1.0, noise, 1, size=(150, 150), low=low, high=low + contrast)
        assert passed(grey, truth).all(), (pitch, noise)


def test_steeply_tilted_corners_pass():
    """Squares a third as high as wide."""
    for seed in range(3):
        grey, truth, _ = board(24.0, 1.2, 0.4 * seed, 1.0, 2.0, seed, size=(160, 160))
        assert passed(grey, truth).all()


@pytest.mark.parametrize("noise", [20, 40, 60])
def test_peaks_of_the_network_pass_in_noise(noise):
    """What the network answers to above the threshold, at corners, lies in marked cells."""
    model, config, count = load_model("auto"), DetectorConfig(), 0
    for seed, (pitch, blur) in enumerate([(6, 1.0), (8, 1.5), (10, 2.0), (14, 2.0), (25, 1.0), (30, 3.0)]):
        grey, truth, _ = board(pitch, 0.4, 0.2 + seed, blur, noise, seed, size=(150, 163))
        found = find_maxima(model(grey, 1), config)
        xy = found.xy[found.score >= found.level]
        gap = np.linalg.norm(xy[:, None] - truth, axis=2).min(axis=1)
        count += (gap < 2).sum()
        assert passed(grey, xy[gap < 2], reach=0).all(), (pitch, blur)
    assert count > 150


@pytest.mark.parametrize("size", [(40, 48), (41, 48), (40, 47), (43, 45)])
def test_corners_at_the_border_pass(size):
    """3 px from each side, in pictures of even and odd sizes."""
    (h, w), near = size, 3
    spots = [(near, h / 2), (w - 1 - near, h / 2), (w / 2, near), (w / 2, h - 1 - near), (near, near)]
    spots += [(w - 1 - near, h - 1 - near), (w - 1 - near, near)]
    for x, y in spots:
        for turn in (0.1, 0.5, 0.8):
            assert passed(corner_at((x, y), turn, size), np.array([[x, y]])).all(), (x, y, turn)


def test_only_the_surroundings_of_a_corner_are_marked():
    y, x = np.nonzero(inner(cells_with_saddles(corner_at((50.0, 42.0), 0.4, (90, 100)))))
    assert 0 < len(x) <= 25
    assert np.abs(CELL * (x + 2) + 1.5 - 50).max() <= 12
    assert np.abs(CELL * (y + 2) + 1.5 - 42).max() <= 12


@pytest.mark.parametrize("level", [0, 7, 128, 255])
def test_nothing_passes_in_a_flat_picture(level):
    for kind in (np.uint8, np.float32):
        assert not cells_with_saddles(np.full((61, 75), level, kind)).any()


@pytest.mark.parametrize(
    ("turn", "blur"),
    [(t, b) for t in (0.0, 0.05, 0.3, np.pi / 2) for b in (0.5, 1.0, 4.0)] + [(np.pi / 4, 4.0), (1.2, 1.0), (1.2, 4.0)],
)
def test_straight_edges_do_not_pass(turn, blur):
    """Nor do they with a little noise: in front of a whole picture's contrast it makes few saddles."""
    assert not inner(cells_with_saddles(half_plane(turn, (90, 103), blur, low=10, high=240))).any()
    assert inner(cells_with_saddles(half_plane(turn, (90, 103), blur, noise=2.0, low=10, high=240))).mean() < 0.02


@pytest.mark.parametrize("turn", [np.pi / 4, 1.2])
def test_sharp_slanting_edges_pass_at_most_along_themselves(turn):
    """The filters are not quite round: of sharp edges the most slanting look like saddles."""
    size = (90, 103)
    cells = cells_with_saddles(half_plane(turn, size, 0.5, low=10, high=240))
    y, x = np.nonzero(inner(cells))
    middle = CELL * (np.column_stack([x, y]) + 2) + 1.5 - np.array(size[::-1]) / 2
    assert np.abs(middle @ [np.cos(turn), np.sin(turn)]).max() < 10


def test_a_slope_does_not_pass():
    y, x = np.mgrid[:60, :90]
    assert not inner(cells_with_saddles((0.8 * x + 1.5 * y).astype(np.float32))).any()
    assert not inner(cells_with_saddles((x * x / 40).astype(np.float32))).any()


def test_little_passes_in_faint_noise():
    """Under the floor of 6 grey levels noise is flat; strong noise has saddles as a board has."""
    rng = np.random.default_rng(7)
    noise = rng.normal(0, 1, (200, 240))
    share = [cells_with_saddles(np.clip(128 + s * noise, 0, 255).astype(np.uint8)).mean() for s in (1, 2, 4)]
    assert share[0] == 0
    assert share[1] < 0.01
    assert share[2] < 0.25


def clutter(seed, size=(120, 150)):
    """A board in noise, float32, from 90 to 150 or so: there is room for offsets and gains."""
    grey, _, _ = board(12.0, 0.5, 0.3, 1.0, 8.0, seed, size=size, low=90.0, high=150.0)
    return grey.astype(np.float32)


def test_offsets_change_nothing():
    for seed in range(3):
        grey = clutter(seed)
        known = cells_with_saddles(grey)
        assert 0.1 < known.mean() < 0.99
        for offset in (-40.0, 16.0, 60.0):
            assert (cells_with_saddles(grey + np.float32(offset)) == known).all()


def test_gain_loses_nothing():
    """A floor is added to the contrast, so that what passes passes with any more contrast;
    and corners with a fifth of it."""
    for seed in range(3):
        grey = clutter(seed)
        before = np.zeros_like(cells_with_saddles(grey))
        for gain in (0.2, 0.5, 1.0, 2.0, 4.0):
            after = cells_with_saddles((np.float32(gain) * (grey - 120)).astype(np.float32))
            assert (after >= before).all()
            before = after
    grey, truth, _ = board(20.0, 0.4, 0.3, 1.0, 0.0, 3, size=(120, 150))
    for gain in (0.2, 0.5, 1.0, 1.3):
        assert passed((gain * (grey.astype(np.float32) - 128) + 128).astype(np.float32), truth).all()


def test_light_and_dark_are_alike():
    for seed in range(3):
        grey = clutter(seed).astype(np.uint8)
        assert (cells_with_saddles(255 - grey) == cells_with_saddles(grey)).all()


def test_bytes_and_floats_are_alike():
    grey = clutter(5).astype(np.uint8)
    for part in (grey, grey[:119, :149], grey[:7, :9]):
        assert (cells_with_saddles(part) == cells_with_saddles(part.astype(np.float32))).all()


def test_a_picture_turned_round_has_its_cells_turned_round():
    """Sides of multiples of 8 px: blocks and cells lie as they did."""
    grey = clutter(6, (128, 160)).astype(np.uint8)
    known = cells_with_saddles(grey)
    for turned, cells in [(grey.T, known.T), (grey[::-1, ::-1], known[::-1, ::-1]), (grey[:, ::-1], known[:, ::-1])]:
        assert (cells_with_saddles(np.ascontiguousarray(turned)) == cells).mean() > 0.999


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (40, 1), (2, 2), (3, 3), (5, 9), (4, 5), (2, 300), (300, 3), (7, 7)])
@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_tiny_pictures(size, kind):
    rng = np.random.default_rng(8)
    for grey in (np.zeros(size, kind), rng.integers(0, 256, size).astype(kind)):
        cells = cells_with_saddles(grey)
        assert cells.shape == (-(-size[0] // 4), -(-size[1] // 4)) == every_cell(grey).shape
        assert cells.dtype == bool
    assert every_cell(grey).all()


def test_a_corner_in_a_tiny_picture_passes():
    for size in [(9, 9), (10, 13), (12, 12)]:
        middle = (np.array(size[::-1]) - 1) / 2
        assert passed(corner_at(tuple(middle), 0.3, size), middle[None]).all()


def test_a_stricter_share_marks_less():
    grey = clutter(9)
    cells = [cells_with_saddles(grey, share) for share in (0.0, 0.05, 0.115, 0.2, 0.4, 5.0)]
    assert all((a >= b).all() for a, b in pairwise(cells))
    assert cells[0].sum() > cells[3].sum() > cells[5].sum() == 0


def test_other_layouts_of_memory_are_alike():
    grey = clutter(10)
    assert (cells_with_saddles(np.asfortranarray(grey)) == cells_with_saddles(grey)).all()
    assert (cells_with_saddles(np.repeat(grey, 2, axis=1)[:, ::2]) == cells_with_saddles(grey)).all()


def chequer(pitch, contrast, blur, noise, size=(160, 160)):
    """A checkerboard that fills a picture."""
    y, x = np.mgrid[: 4 * size[0], : 4 * size[1]] / 4
    squares = ((x // pitch + y // pitch) % 2).astype(np.float32)
    grey = cv2.resize(cv2.GaussianBlur(squares, (0, 0), 4 * blur), size[::-1], interpolation=cv2.INTER_AREA)
    return np.clip(120 + contrast * (grey - 0.5) + np.random.default_rng(3).normal(0, noise, size), 0, 255).astype(
        np.uint8
    )


@pytest.mark.parametrize("pitch", [5.0, 6.5, 8.0, 10.0])
@pytest.mark.parametrize(("contrast", "blur", "noise"), [(170, 0.7, 17), (40, 0.7, 4), (60, 1.2, 2)])
def test_small_squares_are_steep_all_over(pitch, contrast, blur, noise):
    for floor in (STEEP_FLOOR, STEEP_FLOOR_BESIDE):
        cells, _, steep = saddles_by_steepness(chequer(pitch, contrast, blur, noise), floor)
        assert inner(steep).mean() > 0.97
        assert cells[steep].all()


def test_noise_has_many_saddles_but_few_steep_ones():
    noise = np.random.default_rng(1).normal(128, 30, (400, 400)).clip(0, 255).astype(np.uint8)
    smooth = cv2.GaussianBlur(noise.astype(np.float32), (0, 0), 2.5)
    for grey in (noise, smooth):
        cells, _, steep = saddles_by_steepness(grey, STEEP_FLOOR_BESIDE)
        assert steep.mean() < 0.2 * cells.mean()

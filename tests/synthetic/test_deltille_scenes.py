"""Rendered deltilles: the six sectors of every true corner, exact averages, what is printed,
and whose corners have labels."""

from dataclasses import replace

import numpy as np
import pytest
from plain_scene import board, empty

from rcdn.geometry import unproject
from rcdn.synthetic import (
    DELTILLE,
    DELTILLE_TRAINING,
    HARD,
    BoardSpec,
    random_crop,
    random_scene,
    render,
    scene_from_json,
    truth,
)
from rcdn.synthetic.crops import crop_scene
from rcdn.synthetic.lattice import labels, steps
from rcdn.synthetic.pattern import sheet
from rcdn.synthetic.surface import board_to_pixels, rays_to_board

INK = {"black": 0.1, "white": 0.9, "pattern": "deltille"}


def plain(cols=8, rows=7, **spec):
    return BoardSpec(cols, rows, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), **(INK | spec))


def ink(spec, u, v, width):
    u, v = np.broadcast_arrays(np.asarray(u, np.float32), np.asarray(v, np.float32))
    w = np.full(u.shape, width, np.float32)
    return sheet(spec, u, v, w, w, w)[0]


@pytest.mark.parametrize("rvec", [(0.0, 0.0, 0.3), (0.7, -0.4, 0.2), (-0.2, 1.0, 2.0)], ids=["flat", "tilted", "steep"])
@pytest.mark.parametrize("swap", [False, True])
def test_six_sectors_of_two_colours_meet_in_every_true_corner(rvec, swap):
    """The first sector, between the axes i and j, is dark; its opposite is bright."""
    scene = empty()
    scene = replace(scene, boards=(board(scene, rvec, pitch=34.0, cols=5, rows=4, swap=swap, **INK),))
    image, known = render(scene).astype(float), truth(scene)[0]
    assert known.visible.all()
    around = np.stack(
        [board_to_pixels(scene.boards[0], scene.camera, known.ij + s) for s in steps(scene.boards[0])], axis=1
    )
    middle = (known.xy[:, None] + around + np.roll(around, -1, axis=1)) / 3
    x, y = np.rint(middle).astype(int).reshape(-1, 2).T
    sectors = image[y, x].reshape(-1, 6)
    bright = np.array([0, 1, 0, 1, 0, 1], bool) ^ swap
    assert sectors[:, bright].min() > 200
    assert sectors[:, ~bright].max() < 55


def test_corners_lie_at_i_plus_half_j_and_half_root_three_j():
    scene = empty()
    spec = board(scene, pitch=30.0, cols=6, rows=5, **INK)
    xy = board_to_pixels(spec, scene.camera, labels(spec))
    ij = labels(spec)
    assert xy - xy[0] == pytest.approx(30.0 * np.stack([ij[:, 0] + ij[:, 1] / 2, ij[:, 1] * np.sqrt(0.75)], axis=1))
    left = xy.reshape(5, 6, 2)[:, 0, 0] - xy[0, 0]
    assert left == pytest.approx([0, 15, 0, 15, 0])  # rows set off by half an edge in turn
    u, v = rays_to_board(spec, unproject(scene.camera, xy))
    assert np.stack([u, v], axis=1) == pytest.approx(ij, abs=1e-9)


@pytest.mark.parametrize("width", [1e-3, 0.05, 0.3, 1.0])
def test_a_period_is_half_black(width):
    u, v = np.meshgrid(*2 * [(np.arange(200) + 0.5) / 200])
    assert ink(plain(), 2 + u, 2 + v, width).mean() == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize(("u", "v"), [(2.6, 2.02), (2.02, 2.6), (2.37, 2.64)])
def test_a_footprint_across_an_edge_is_the_mean_of_its_points(u, v):
    """Of the one family of edges that it meets: along the others nothing changes there."""
    w = 0.2
    across = ((np.arange(4000) + 0.5) / 4000 - 0.5) * w
    du, dv = (across, 0) if u < 2.1 else (0, across) if v < 2.1 else (across / 2, across / 2)
    fine = ink(plain(), u + du, v + dv, 1e-4).mean()
    assert ink(plain(), u, v, w) == pytest.approx(fine, abs=2e-3)


def test_every_triangle_at_an_inner_corner_is_printed_and_no_other():
    spec = plain(4, 3, margin=3.0, margin_value=0.5)
    lattice = np.array([(i, j) for i in range(-5, 8) for j in range(-3, 6)])
    held = {tuple(a) for a in labels(spec).tolist()}
    for shift, tips in (((1 / 3, 1 / 3), ((0, 0), (1, 0), (0, 1))), ((2 / 3, 2 / 3), ((1, 1), (1, 0), (0, 1)))):
        value = ink(spec, *(lattice + shift).T, 1e-3)
        printed = np.array([any((i + d, j + e) in held for d, e in tips) for i, j in lattice.tolist()])
        assert (np.abs(value - 0.5) > 0.3).tolist() == printed.tolist()


def test_bleed_makes_dark_triangles_smaller():
    u, v = np.meshgrid(*2 * [2 + (np.arange(300) + 0.5) / 300])
    share = [(0.9 - ink(plain(bleed=b), u, v, 1e-3).mean()) / 0.8 for b in (-0.05, 0.0, 0.05)]
    assert share == pytest.approx([1 - 0.5 * (1 - 3 * 0.05) ** 2, 0.5, 0.5 * (1 - 3 * 0.05) ** 2], abs=0.01)


def test_only_ranges_with_deltilles_draw_them():
    for seed in range(10):
        assert all(b.pattern == "checker" for b in random_scene(np.random.default_rng(seed), HARD).boards)
        scene = random_scene(np.random.default_rng(seed), DELTILLE)
        assert [b.pattern for b in scene.boards] == ["deltille"]
        assert truth(scene)[0].visible.sum() >= 0.9 * len(labels(scene.boards[0]))  # wholly in the frame
        assert scene_from_json(scene.to_json()) == scene


def test_checkerboards_among_deltilles_are_clutter():
    kinds = {"checker": 0, "deltille": 0}
    for seed in range(40):
        scene, _ = crop_scene(seed, 112, DELTILLE_TRAINING, 0)
        patterns = {b.pattern for b in scene.boards}
        if len(patterns) != 1:
            continue
        count = len(random_crop(seed, 112, DELTILLE_TRAINING)[1])
        pattern = patterns.pop()
        kinds[pattern] += count > 0
        assert pattern == "deltille" or count == 0
    assert kinds["deltille"] >= 10

"""The renderer against an independent estimator, its truth flags, its windows and its repeatability."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from plain_scene import BROWN, FISHEYE, board, corners_of, empty

from rcdn.corners.adaptive import adaptive_fit
from rcdn.geometry import unproject
from rcdn.synthetic import HARD, Bend, Cover, Light, Sensor, random_scene, render, scene_from_json, truth
from rcdn.synthetic.render import irradiance
from rcdn.synthetic.surface import rays_to_board

FAR_FISHEYE = FISHEYE | {"focal": 2000.0, "centre": (-1500.0, 150.0)}
"""Part of a large fisheye picture, 0.85 rad off the axis: strong distortion, little curvature within a square"""


def with_board(lens=None, **settings):
    scene = empty(**(lens or {}))
    return replace(scene, boards=(board(scene, **settings),))


@pytest.mark.parametrize("samples", [2, 8])
@pytest.mark.parametrize(
    "scene",
    [
        with_board(rvec=(0.1, 0.05, 0.3)),
        with_board(rvec=(0.4, -0.5, 0.2), pitch=22.0, swap=True, aspect=1.2),
        with_board(rvec=(0.9, 0.2, -2.5)),
        with_board(BROWN, rvec=(0.3, -0.4, 0.2)),
        with_board(FAR_FISHEYE, rvec=(0.1, 0.9, 0.2), pitch=20.0),
        with_board(rvec=(0.3, -0.2, 0.1), bend=Bend(curvature=0.01, angle=0.5)),
        with_board(rvec=(0.3, -0.2, 0.1), bend=Bend(amplitude=0.02, period=8, phase=1.0, angle=2.0)),
        with_board(rvec=(0.1, 0.05, 0.3), bleed=0.05),
        with_board(rvec=(0.1, 0.05, 0.3), bleed=-0.05),
    ],
    ids=["flat", "aspect", "steep", "brown", "fisheye", "cylinder", "wave", "white ink", "black ink"],
)
def test_truth_is_where_the_corners_are_drawn(scene, samples):
    """A surface fit and a symmetry centre know nothing of the renderer: 0.01 px."""
    light = cv2.GaussianBlur(irradiance(scene, samples=samples), (0, 0), 0.7) * 200
    known = truth(scene)[0]
    assert known.visible.all()
    found = adaptive_fit(light, np.rint(known.xy).astype(int), known.pitch)
    assert np.abs(found - known.xy).max() < 0.01


def test_pitch_is_the_distance_to_the_nearest_neighbour():
    known = truth(with_board(rvec=(0, 0, 0.7), pitch=20.0, aspect=1.25))[0]
    assert known.pitch == pytest.approx(np.full(35, 20.0), abs=1e-3)
    assert known.ij.tolist() == corners_of(with_board().boards[0]).tolist()


@pytest.mark.parametrize("lens", [{}, BROWN, FISHEYE | {"focal": 200.0}], ids=["pinhole", "brown", "fisheye"])
def test_window_is_the_crop_of_the_whole(lens):
    """All but its outermost pixels, where the footprint is a one-sided difference."""
    scene = with_board(lens, rvec=(0.3, -0.4, 0.2))
    scene = replace(scene, covers=(Cover(150, 100, 180, 160, 12, 0.3),), light=Light(gx=0.8, gy=-0.5, wave=0.2))
    x, y, w, h = window = (120, 90, 131, 87)
    whole, part = render(scene)[y : y + h, x : x + w].astype(int), render(scene, window).astype(int)
    assert np.array_equal(whole[1:-1, 1:-1], part[1:-1, 1:-1])
    assert np.abs(whole - part).max() <= 5
    assert part.std() > 50


def test_more_samples_converge():
    scene = with_board(rvec=(0.4, -0.5, 0.2))
    one, four, sixteen = (irradiance(scene, samples=n) for n in (1, 4, 16))
    assert np.abs(four - sixteen).mean() < 0.25 * np.abs(one - sixteen).mean()


def flags(scene, index=0):
    known = truth(scene)[index]
    return known.visible.reshape(5, 7), known.ignore.reshape(5, 7)


def test_cover_hides_the_truth():
    scene = with_board(pitch=30.0)  # corner (3, 2) at (200.3, 150.2)
    visible, ignore = flags(replace(scene, covers=(Cover(200.3, 150.2, 200.3, 150.2, 20),)))
    hidden = np.zeros((5, 7), bool)
    hidden[2, 3] = True
    assert np.array_equal(visible, ~hidden)
    assert not ignore.any()  # 30 px away from the middle of a cover of 20 px


@pytest.mark.parametrize(("half", "seen", "doubtful"), [(25, 4, 0), (27, 2, 2), (31, 2, 2), (33, 2, 0)])
def test_corners_at_the_rim_of_a_cover_are_doubtful(half, seen, doubtful):
    """Rows of corners 30 px above and below the middle of a bar of half width `half`, px; two more beyond."""
    visible, ignore = flags(replace(with_board(), covers=(Cover(0, 150.2, 400, 150.2, half, square=True),)))
    assert visible.all(axis=1).sum() == visible.any(axis=1).sum() == seen
    assert ignore.all(axis=1).sum() == ignore.any(axis=1).sum() == doubtful


def test_nearer_board_hides_the_farther():
    base = empty()
    far, near = board(base, pitch=25.0), board(base, at=(275.0, 150.2), pitch=30.0, margin=0.2, black=0.3, white=0.6)
    for boards in ((far, near), (near, far)):
        scene = replace(base, boards=boards)
        visible, ignore = flags(scene, boards.index(far))
        # columns are at 125, 150, 175 … px; the near sheet begins at 275 − 4.2 × 30 = 149 px
        assert visible[:, 0].all()
        assert not visible[:, 1:].any()
        assert np.array_equal(np.flatnonzero(ignore.any(axis=0)), [1])
        assert flags(scene, boards.index(near))[0].all()
    assert np.array_equal(render(scene), render(replace(scene, boards=boards[::-1])))


@pytest.mark.parametrize(
    ("settings", "visible", "ignore"),
    [
        ({"at": (90.3, 150.2)}, 6, 1),  # columns at 0.3, 30.3, …: the first one lies on the frame's rim
        ({"at": (56.3, 150.2)}, 5, 1),  # the first one is outside
        ({"at": (54.3, 150.2)}, 5, 0),
        ({"pitch": 3.9}, 0, 7),
        ({"pitch": 4.1}, 7, 0),
        ({"painted": ((3, 2, 0.5),)}, 5, 2),
        ({"rvec": (0.0, np.pi, 0.0), "at": (200.3, 150.2)}, 0, 0),  # its back
    ],
)
def test_doubtful_corners(settings, visible, ignore):
    """Seen in the middle row of corners."""
    sure, doubtful = flags(with_board(**settings))
    assert (sure[2].sum(), doubtful[2].sum()) == (visible, ignore)


def test_visible_corners_are_seen_where_the_truth_says():
    """The ray through a corner's pixel meets the sheet at that corner."""
    worst = 0.0
    for seed in range(60):
        scene = random_scene(np.random.default_rng(seed), HARD)
        for spec, known in zip(scene.boards, truth(scene), strict=True):
            u, v = rays_to_board(spec, unproject(scene.camera, known.xy[known.visible]))
            gap = np.hypot(u - known.ij[known.visible, 0], v - known.ij[known.visible, 1])
            worst = max(worst, float(gap.max(initial=0)))
    assert worst < 1e-6


@pytest.mark.parametrize("seed", [263, 1239, 1503])
def test_nothing_is_visible_beyond_the_fold_or_behind_a_bend(seed):
    scene = random_scene(np.random.default_rng(seed), HARD)
    for spec, known in zip(scene.boards, truth(scene), strict=True):
        u, v = rays_to_board(spec, unproject(scene.camera, known.xy[known.visible]))
        assert np.hypot(u - known.ij[known.visible, 0], v - known.ij[known.visible, 1]).max(initial=0) < 1e-3


@pytest.mark.parametrize("seed", range(4))
def test_a_scene_replays_from_json(seed):
    scene = random_scene(np.random.default_rng(seed), HARD, size=(160, 120))
    again = scene_from_json(scene.to_json())
    assert again == scene
    picture = render(scene, samples=2)
    assert np.array_equal(picture, render(again, samples=2))
    assert picture.shape == (120, 160)
    assert picture.dtype == np.uint8


def test_the_seed_draws_the_noise():
    scene = replace(with_board(), sensor=Sensor(noise=5.0))
    assert np.array_equal(render(scene, samples=1), render(scene, samples=1))
    other = render(replace(scene, seed=1), samples=1).astype(float) - render(scene, samples=1)
    dark = other[140:160, 10:40]  # plain background, not clipped
    assert dark.std() == pytest.approx(5 * np.sqrt(2), rel=0.1)

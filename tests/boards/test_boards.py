"""Recovery as a whole: no corner may ever have a wrong label."""

from dataclasses import replace

import numpy as np
import pytest
from board_scene import SIZE, VIEWS, View, board, candidates, clutter, right_handed, scene, view
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.boards import find_boards
from rcdn.geometry import apply_homography, homography
from rcdn.synthetic import Cover, Ranges, random_scene
from rcdn.synthetic.degrade import signed_distance

ANY = Ranges(
    pitch=(14, 45), cells=(3, 10), tilt=65, fisheye_p=0.3, distortion=0.35, bend_p=0.25, cover_p=0.3, bleed_p=0.2,
    light=1.2, several_p=0.15, whole=False, invert_p=0.3,
)  # fmt: skip


@pytest.mark.parametrize("start", range(0, 72, 12))
def test_no_wrong_label_on_random_scenes(start):
    """Perspective, lenses, bends, covers, cut and several boards; with and without false corners."""
    seen = recovered = 0
    for seed in range(start, start + 12):
        shown = View(random_scene(np.random.default_rng(seed), ANY, SIZE))
        if len(shown) < 2:
            continue
        for extra in (None, clutter(shown, 40, seed)):
            found = shown.found(extra=extra)
            assert sum(map(shown.wrong, found)) == 0, f"scene {seed}"
            assert all(map(right_handed, found)), f"scene {seed}"
        seen, recovered = seen + len(shown), recovered + sum(map(len, found))
    assert recovered > 0.8 * seen


@pytest.mark.parametrize("name", VIEWS)
def test_whole_boards_come_back_whole(name):
    shown = view(name)
    (found,) = shown.found()
    assert found.complete
    assert len(found) == len(shown)
    assert shown.wrong(found) == 0
    assert right_handed(found)
    assert found.image_size == SIZE


@settings(max_examples=30, deadline=None, derandomize=True)
@given(st.integers(0, 100_000), st.sampled_from(sorted(VIEWS)), st.integers(1, 120))
def test_false_corners_never_enter(seed, name, count):
    shown = view(name)
    (found,) = shown.found(extra=clutter(shown, count, seed), seed=seed)
    assert shown.wrong(found) == 0
    assert len(found) == len(shown)


@pytest.mark.parametrize("margin", [0.0, 0.4, 1.5])
@pytest.mark.parametrize("name", ["flat", "tilted", "noisy"])
def test_the_outer_rim_of_the_print_never_enters(name, margin):
    """T-junctions lie exactly where the next corners would: as candidates they have all that the lattice asks for."""
    shown = view(name, margin=margin)
    H = homography(shown.ij, shown.xy)
    cols, rows = shown.sizes[0]
    rim = np.array(
        [(i, j) for j in range(-1, rows + 1) for i in range(-1, cols + 1) if i in (-1, cols) or j in (-1, rows)]
    )
    extra = apply_homography(H, rim)
    inside = ((extra > 4) & (extra < np.array(SIZE) - 5)).all(axis=1)
    (found,) = shown.found(extra=extra[inside])
    assert shown.wrong(found) == 0
    assert len(found) == len(shown)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.sets(st.integers(0, 53), max_size=20), st.sampled_from(["barrel", "fisheye", "small"]))
def test_missing_corners_mislead_nobody(gone, name):
    shown = view(name)
    found = shown.found(without=gone)
    assert sum(map(shown.wrong, found)) == 0
    if len(gone) <= 3:
        assert sum(map(len, found)) >= len(shown) - len(gone) - 4


@settings(max_examples=25, deadline=None, derandomize=True)
@given(st.sets(st.integers(0, 53), max_size=54), st.sampled_from(["barrel", "fisheye", "small"]))
def test_weak_corners_mislead_nobody(weak, name):
    shown = view(name)
    found = shown.found(weak=weak)
    assert sum(map(shown.wrong, found)) == 0


@pytest.mark.parametrize("gap", [0, 10, 40])
def test_two_boards_side_by_side_come_out_as_two(gap):
    left, right = board(5, 5, 24, 3, 10, at=(-85 - gap, 0)), board(6, 5, 24, -2, 10, at=(85 + gap, 0), swap=True)
    shown = View(scene(boards=(left, right)))
    found = shown.found()
    assert [len(b) for b in found] == [30, 25]
    assert [b.size for b in found] == [(6, 5), (5, 5)]
    assert sum(map(shown.wrong, found)) == 0


def test_boards_come_largest_first():
    boards = tuple(board(c, 4, 20, 5, 10, at=at) for c, at in ((4, (-120, -80)), (7, (110, 80)), (5, (-120, 80))))
    assert [len(b) for b in View(scene(boards=boards)).found()] == [28, 20, 16]


@pytest.mark.parametrize("quadrant", [(-1, -1), (1, -1), (-1, 1), (1, 1)])
def test_a_covered_quadrant_costs_only_its_own_corners(quadrant):
    middle = np.array(SIZE) / 2
    far = middle + np.array(quadrant) * 150
    cover = Cover(
        float(middle[0]),
        float((middle[1] + far[1]) / 2),
        float(far[0]),
        float((middle[1] + far[1]) / 2),
        75.0,
        0.6,
        True,
    )
    shown = View(scene(9, 7, 26, 4, 15, covers=(cover,)))
    (found,) = shown.found()
    away = np.flatnonzero(signed_distance(cover, *shown.xy.T) > 12)  # nearer, the rings around a corner see the cover
    assert 35 < len(away) < 50
    assert set(away) <= set(shown.number(found.xy))
    assert found.size == (9, 7)
    assert shown.wrong(found) == 0


@pytest.mark.parametrize("width", [10, 30, 60, 90])
def test_a_strip_across_leaves_one_board_or_parts_of_it(width):
    """Columns behind a strip must be counted rightly, or the parts be left apart."""
    cover = Cover(240.0, 0.0, 240.0, 360.0, width / 2, 0.6, square=True)
    shown = View(scene(12, 6, 26, 0, 10, covers=(cover,)))
    found = shown.found()
    assert sum(map(shown.wrong, found)) == 0
    assert sum(map(len, found)) >= 0.9 * len(shown)


def strip_scene(seed):
    """A random scene, often with several boards, behind a strip across the frame."""
    rng = np.random.default_rng(seed)
    plain = random_scene(rng, replace(ANY, cover_p=0, several_p=0.25), SIZE)
    angle, (x, y) = rng.uniform(0, np.pi), rng.uniform([150, 120], [330, 240]).tolist()
    dx, dy = float(400 * np.cos(angle)), float(400 * np.sin(angle))
    half, value = float(rng.uniform(5, 35)), float(rng.uniform(0, 1))
    return replace(plain, covers=(Cover(x - dx, y - dy, x + dx, y + dy, half, value, square=True),))


@pytest.mark.parametrize("seed", [120, 239, 246, *range(100, 112)])
def test_parts_of_different_boards_are_never_joined(seed):
    shown = View(strip_scene(seed))
    for without in ((), np.flatnonzero(np.random.default_rng(seed).random(len(shown)) < 0.2)):
        assert sum(map(shown.wrong, shown.found(without=without))) == 0


def test_the_least_number_of_corners():
    shown = view(cols=4, rows=3, tilt=20)
    assert [len(b) for b in shown.found(least=12)] == [12]
    assert shown.found(least=13) == []


@pytest.mark.parametrize("count", [2, 3, 30])
def test_no_board_in_clutter(count):
    rng = np.random.default_rng(count)
    grey = rng.integers(0, 256, SIZE[::-1]).astype(np.uint8)
    xy = rng.uniform(5, np.array(SIZE) - 6, (count, 2))
    assert find_boards(grey, candidates(grey, xy, np.full(count, 0.9), np.ones(count, bool))) == []


@pytest.mark.parametrize("count", [0, 1])
def test_no_board_without_corners(count):
    shown = view("flat")
    everything = shown.candidates()
    few = type(everything)(
        everything.all.take(slice(count)),
        type(everything.orientation)(*(v[:count] for v in vars(everything.orientation).values())),
        everything.sure[:count],
        everything.seed[:count],
    )
    assert find_boards(shown.grey, few) == []


@pytest.mark.parametrize("name", ["tilted", "fisheye"])
def test_the_same_input_gives_the_same_bytes(name):
    shown = view(name)
    given_ = shown.candidates(extra=clutter(shown, 60, 1), weak=[3, 9, 20])
    first, again = find_boards(shown.grey, given_), find_boards(shown.grey.copy(), given_)
    assert len(first) == len(again) == 1
    for a, b in zip(first, again, strict=True):
        for key in ("xy", "ij", "response", "status"):
            assert getattr(a, key).tobytes() == getattr(b, key).tobytes()


def test_positions_are_those_of_the_candidates():
    """Recovery labels corners; it doesn't move them."""
    shown = view("wave")
    given_ = shown.candidates()
    (found,) = find_boards(shown.grey, given_)
    assert set(map(tuple, found.xy.tolist())) == set(map(tuple, given_.all.xy.tolist()))

"""Parts of one board that nothing joins come out as one board; parts of two don't."""

import cv2
import numpy as np
import pytest

from rcdn.boards.graph import Field
from rcdn.boards.local import Grid
from rcdn.boards.merge import _Frame, merge
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.geometry.division import Division
from rcdn.metrics import match
from rcdn.synthetic import BoardSpec, Cover, Scene, Sensor, render, truth


@pytest.fixture(scope="module")
def detector():
    return Detector(DetectorConfig.auto(threads=1))


def scene(*covers, boards=None):
    board = BoardSpec(12, 7, (0.25, -0.3, 0.1), (-5.2, -3, 21))
    return Scene(640, 480, 500, (320, 240), boards=boards or (board,), covers=covers, sensor=Sensor(noise=2.0))


def test_a_ruler_across_a_board_leaves_one_board(detector):
    """The bar hides one column of corners or so: no edge joins the two halves."""
    shown = scene(Cover(318, -20, 322, 500, 14, 0.6))
    known = truth(shown)[0]
    boards = detector.boards(render(shown))
    assert len(boards) == 1
    pairs, gaps = match(boards[0].xy, known.xy, 2)
    assert len(pairs) == len(boards[0])
    assert len(boards[0]) >= 0.9 * known.visible.sum()
    shift = known.ij[pairs[:, 1]] - boards[0].ij[pairs[:, 0]]
    turned = known.ij[pairs[:, 1]] + boards[0].ij[pairs[:, 0]]
    assert len(np.unique(shift, axis=0)) == 1 or len(np.unique(turned, axis=0)) == 1
    assert gaps.mean() < 0.1


def test_two_boards_a_square_apart_stay_two(detector):
    """Side by side on one plane, but half a square out of step."""
    left = BoardSpec(5, 6, (0.1, 0.1, 0), (-6.5, -3, 20), margin=0.2)
    right = BoardSpec(5, 6, (0.1, 0.1, 0), (0.5, -2.5, 20.3), margin=0.2)
    boards = detector.boards(render(scene(boards=(left, right))))
    assert sorted(b.size for b in boards) == [(5, 6), (5, 6)] or sorted(b.size for b in boards) == [(6, 5), (6, 5)]


def halves(turns, shift, gap, off, colour=1):
    """A bent lattice of 5 × 9 corners in two grids with `gap` rows between them: the second has labels of its own,
    and lies `off` squares aside."""
    ij = np.array([(u, v) for v in range(9) for u in range(5)])
    lower = ij[:, 1] >= 4 + gap
    xy = (ij + lower[:, None] * [off, 0]) @ [[21.0, 3.0], [-2.0, 19.0]] + 0.1 * ij**2 + 50
    one = np.ones(len(ij))
    parity = 1 - 2 * (ij.sum(axis=1) % 2)
    axes = np.tile(np.arctan2([3.0, 19.0], [21.0, -2.0]), (len(ij), 1))
    field = Field(np.zeros((9, 9)), xy, axes, np.where(lower, colour, 1) * parity, one, one, one, one > 0, one > 0)
    own = ij.copy()
    for _ in range(turns):
        own = np.stack([own[:, 1], -own[:, 0]], axis=1)
    own += shift
    upper = ij[:, 1] < 4
    return field, [
        Grid({(int(u), int(v)): k for k, (u, v) in enumerate(ij) if upper[k]}, xy),
        Grid({(int(u), int(v)): k for k, (u, v) in enumerate(own) if lower[k]}, xy),
    ]


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("gap", [0, 1, 2])
def test_halves_join_whatever_their_own_labels_are(turns, gap):
    field, grids = halves(turns, [7, -4], gap, 0.0)
    (joined,) = merge(field, grids)
    expected = {s: k for k, s in enumerate((u, v) for v in range(9) for u in range(5)) if not 4 <= s[1] < 4 + gap}
    start = next(s for s, k in joined.at.items() if k == 0)
    step = next(s for s, k in joined.at.items() if k == 1)
    d, e = step[0] - start[0], step[1] - start[1]
    assert {(start[0] + d * u - e * v, start[1] + e * u + d * v): k for (u, v), k in expected.items()} == joined.at


@pytest.mark.parametrize("wide", [False, True], ids=["perspective", "and a wide lens"])
@pytest.mark.parametrize(("tilt", "axis"), [(0.9, 0.0), (0.9, 1.57), (0.6, 0.8)])
@pytest.mark.parametrize("gap", [0, 1, 2])
def test_halves_of_a_tilted_board_join(gap, tilt, axis, wide):
    """Of three lines on each side, extrapolated in the picture, the next ones would be far off."""
    ij = np.array([(u, v) for v in range(6 + gap) for u in range(8)])
    lower = ij[:, 1] >= 3 + gap
    board = np.column_stack([ij - [3.5, 2.5 + gap / 2], np.zeros(len(ij))])
    R = cv2.Rodrigues(tilt * np.array([np.cos(axis), np.sin(axis), 0.0]))[0]
    at = board @ R.T + [0.4, 0.3, 8.0]
    xy = 420 * at[:, :2] / at[:, 2:]
    if wide:
        xy = xy / (1 + 0.4 * (xy**2).sum(axis=1, keepdims=True) / 400**2)
    xy = xy + np.array([319.5, 239.5]) + np.random.default_rng(0).normal(0, 0.1, xy.shape)
    keep = (ij[:, 1] < 3) | lower
    ij, xy, lower = ij[keep], xy[keep], lower[keep]
    one, axes = np.ones(len(ij)), np.zeros((len(ij), 2))
    parity = 1 - 2 * (ij.sum(axis=1) % 2)
    field = Field(np.zeros((480, 640)), xy, axes, parity, one, one, one, one > 0, one > 0)
    grids = [
        Grid({(int(u), int(v)): k for k, (u, v) in enumerate(ij) if not lower[k]}, xy),
        Grid({(int(u), int(v) + 7): k for k, (u, v) in enumerate(ij) if lower[k]}, xy),
    ]
    (joined,) = merge(field, grids)
    (first, k), *_ = joined.at.items()
    assert {(u - first[0] + ij[k, 0], v - first[1] + ij[k, 1]): n for (u, v), n in joined.at.items()} == {
        (int(u), int(v)): n for n, (u, v) in enumerate(ij)
    }


def bare(xy):
    """A field of corners at these positions, and two grids of 4 × 3 of them."""
    ij = np.array([(u, v) for v in range(3) for u in range(4)])
    one = np.ones(len(xy))
    field = Field(np.zeros((480, 640)), xy, np.zeros((len(xy), 2)), one, one, one, one, one > 0, one > 0)
    return field, [Grid({(int(u), int(v)): k + n for k, (u, v) in enumerate(ij)}, xy) for n in (0, 12)]


@pytest.mark.parametrize("seed", range(20))
def test_lattices_that_are_none_are_no_trouble(seed):
    """On one line, in one place, or anywhere."""
    rng = np.random.default_rng(seed)
    anywhere = rng.uniform(0, 480, (24, 2))
    line = rng.uniform(0, 480, 24)[:, None] * [1.0, 0.5] + [3.0, 40.0]
    for xy in (anywhere, line, np.repeat(anywhere[:2], 12, axis=0), np.sort(np.rint(line), axis=0)):
        field, grids = bare(xy)
        assert sorted(len(g) for g in merge(field, grids)) in ([12, 12], [24])


def test_a_frame_ends_at_its_horizon_and_where_its_lens_shows_nothing():
    lens = Division(-0.25, np.array([310.0, 250.0]), 400.0)
    inside, beyond = np.array([[310.0, 250.0], [310.0, 1000.0]]), np.array([[310.0, 250.0], [310.0, 1060.0]])
    assert _Frame(np.eye(3), lens).shows(inside)
    assert not _Frame(np.eye(3), lens).shows(beyond)
    assert _Frame(np.eye(3), None).shows(beyond)
    leaning = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, -1e-3, 1.0]])
    assert not _Frame(leaning, None).shows(beyond)
    assert not _Frame(-leaning, None).shows(beyond)
    assert _Frame(-leaning, None).shows(beyond / 2)


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
@pytest.mark.parametrize("seed", range(4))
def test_an_arm_across_a_tilted_board_leaves_one_board(detector, seed, model):
    rng = np.random.default_rng(seed)
    lean, across = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    R = cv2.Rodrigues(0.8 * np.array([np.cos(lean), np.sin(lean), 0.0]))[0]
    t = np.array([0.3, 0.2, 13.0 if model == "pinhole" else 7.0]) - R @ [4.0, 2.5, 0]
    board = BoardSpec(9, 6, tuple(cv2.Rodrigues(R)[0].ravel()), tuple(t))
    middle, along = np.array([320.0, 240.0]), 400 * np.array([np.cos(across), np.sin(across)])
    arm = Cover(*(middle - along), *(middle + along), 12, 0.45)
    lens = {} if model == "pinhole" else {"distortion": (-0.02, 0.005, 0.0, 0.0)}
    shown = Scene(
        640, 480, 420 if model == "pinhole" else 260, (320, 240), model, boards=(board,), covers=(arm,),
        sensor=Sensor(noise=2.0), **lens,
    )  # fmt: skip
    known = truth(shown)[0]
    found = detector.boards(render(shown))
    assert len(found) == 1
    pairs, gaps = match(found[0].xy, known.xy, 2)
    assert len(pairs) == len(found[0]) >= 0.9 * known.visible.sum()
    affine = np.linalg.lstsq(
        np.column_stack([found[0].ij[pairs[:, 0]], np.ones(len(pairs))]), known.ij[pairs[:, 1]], None
    )[0]
    assert np.abs(affine - np.rint(affine)).max() < 1e-9
    assert gaps.mean() < 0.1


@pytest.mark.parametrize(
    ("gap", "off", "colour"),
    [(3, 0.0, 1), (1, 0.5, 1), (1, 0.25, 1), (1, 0.0, -1)],
    ids=["too far apart", "half a square aside", "a quarter aside", "colours don't alternate"],
)
def test_what_is_not_one_lattice_stays_apart(gap, off, colour):
    field, grids = halves(1, [7, -4], gap, off, colour)
    assert [len(g) for g in merge(field, grids)] == [len(g) for g in grids]


def test_one_grid_is_left_as_it_is():
    field, (grid, _) = halves(0, [0, 0], 1, 0.0)
    assert merge(field, [grid]) == [grid]
    assert merge(field, []) == []

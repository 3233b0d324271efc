"""The paper's board recovery: initial matrices, growth by lines and by cells, and what is handed on."""

import numpy as np
import pytest
from board_scene import VIEWS, View, board, candidates, clutter, right_handed, scene, turn, view
from hypothesis import given, settings
from hypothesis import strategies as st

from rcdn.boards import find_boards
from rcdn.boards.paper import find_boards_paper, recover
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError


def points(cols, rows, step=20.0, quarters=0, angle=0.0):
    """Corners (N, 2) of a lattice, turned, and their labels (N, 2) in the turned frame."""
    ij = np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2)
    c, s = np.cos(angle + quarters * np.pi / 2), np.sin(angle + quarters * np.pi / 2)
    return ij * step @ np.array([[c, s], [-s, c]]) + 300, ij


def recovered(xy, angle=0.0, first=None, count=2):
    """Grids of points whose edges run along `angle` and across it; `first`: number of the corner
    with the best response."""
    order = np.arange(len(xy)) if first is None else np.r_[first, np.delete(np.arange(len(xy)), first)]
    angles = np.full((len(xy), 4), np.nan)
    angles[:, 0], angles[:, 1] = angle % np.pi, (angle + np.pi / 2) % np.pi
    grids = recover(xy[order], angles, np.full(len(xy), count))
    return [{spot: int(order[c]) for spot, c in grid.items()} for grid in grids]


def consistent(grid, ij):
    """Do the labels differ from `ij` by one quarter turn and shift?"""
    spots, true = np.array(list(grid)), ij[list(grid.values())]
    return any(len(np.unique(spots - turn(true, k), axis=0)) == 1 for k in range(4))


@pytest.mark.parametrize("quarters", range(4))
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.8, 1.5])
@pytest.mark.parametrize("first", [0, 8, 17, 6])
def test_a_perfect_lattice_comes_back_in_every_rotation(quarters, angle, first):
    """From a corner of the lattice (2 × 2), its rim, and its inside (3 × 3)."""
    xy, ij = points(6, 4, quarters=quarters, angle=angle)
    (grid,) = recovered(xy, angle, first)
    assert len(grid) == 24
    assert consistent(grid, ij)


@pytest.mark.parametrize("count", [0, 1, 5, 9])
def test_only_two_to_four_directions_start_a_board(count):
    xy, _ = points(4, 4)
    assert recovered(xy, count=count) == []


def test_the_literal_rule_of_cells_stops_under_perspective():
    """Two rows of corners 20 px apart whose columns come 10 % closer with every step: mean edges 20, 19,
    18.1, 17.29, 16.56, 15.90.

    The rule is 0.8 × 20 = 16: five cells join, the sixth does not, though it is 4 % smaller than its neighbour only.
    """
    x = np.concatenate([[0], np.cumsum(20 * 0.9 ** np.arange(7))])
    xy = np.stack(np.meshgrid(x, [0.0, 20.0]), axis=-1).reshape(-1, 2) + 50
    first, rest = recovered(xy)
    assert sorted(first.values()) == [*range(6), *range(8, 14)]
    assert sorted(rest.values()) == [6, 7, 14, 15]


def test_cells_are_compared_with_the_initial_cell_from_either_side():
    """The same strip from its small end, where the limit is 1.2 times the first cell. No corner is in two boards."""
    x = np.concatenate([[0], np.cumsum(20 * 0.9 ** np.arange(7))])
    xy = np.stack(np.meshgrid(x, [0.0, 20.0]), axis=-1).reshape(-1, 2) + 50
    grids = recovered(xy, first=7)
    mean = [(40 + 40 * 0.9**k) / 4 for k in range(7)]
    joined = sum(m / mean[6] <= 1.2 for m in mean)
    assert len(grids[0]) == 2 * (joined + 1)
    assert sum(map(len, grids)) == len({c for g in grids for c in g.values()})


@pytest.mark.parametrize("first", [0, 1, 7, 8, 26, 36, 45, 53])
def test_a_board_whose_best_corner_is_at_its_rim_comes_whole(first):
    """Columns that come 10 % closer with every step. From the rim only cells grow,
    and end within the board; lines don't."""
    x = np.concatenate([[0], np.cumsum(30 * 0.9 ** np.arange(8))])
    xy = np.stack(np.meshgrid(x, np.arange(6) * 30.0), axis=-1).reshape(-1, 2) + 50
    (grid,) = recovered(xy, first=first)
    assert consistent(grid, points(9, 6)[1])
    assert len(grid) == 54


def test_cells_take_what_lines_leave():
    """A strip of two rows, best response and all, comes after the block of 4 × 4 below it."""
    block, strip = points(4, 4)[0] + [0, 200], points(6, 2)[0]
    one, other = recovered(np.concatenate([block, strip]), first=18)
    assert (sorted(one.values()), sorted(other.values())) == ([*range(16)], [*range(16, 28)])


def test_an_l_of_cells_is_one_board():
    """No 3 × 3 fits into it: growth by cells goes around the bend."""
    xy, ij = points(5, 5)
    keep = (ij[:, 0] < 2) | (ij[:, 1] < 2)
    (grid,) = recovered(xy[keep])
    assert len(grid) == keep.sum() == 16
    assert consistent(grid, ij[keep])


def misled(seed, count, outside):
    """Does `count` points of clutter, in the lattice's hull or around it, give a true corner of the
    first board a wrong label?

    Of the first board only: corners that it leaves over are no lattice any more,
    and may make false boards with the clutter.
    """
    rng = np.random.default_rng(seed)
    angle, first = rng.uniform(0, 3.1), int(rng.integers(35))
    xy, ij = points(7, 5, angle=angle)
    c, s = np.cos(angle), np.sin(angle)
    extra = rng.uniform([-4, -4], [10, 8], (8 * count, 2))
    off = np.abs(extra - [3, 2]) - [3, 2]  # squares beyond the hull
    extra = (extra[(off > 0.3).any(axis=1) if outside else (off < 0).all(axis=1)] * 20 @ [[c, s], [-s, c]] + 300)[
        :count
    ]
    extra = extra[np.linalg.norm(extra[:, None] - xy, axis=2).min(axis=1) > 3]
    grids = [{k: v for k, v in g.items() if v < 35} for g in recovered(np.concatenate([xy, extra]), angle, first)[:1]]
    return any(len(true) > 1 and not consistent(true, ij) for true in grids)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10_000), st.integers(1, 60))
def test_clutter_around_a_lattice_misleads_nobody(seed, count):
    assert not misled(seed, count, outside=True)


def test_clutter_in_a_lattice_seldom_misleads():
    """The literal rules do go wrong: in one of these 150 lattices with twenty false corners inside."""
    assert sum(misled(seed, 20, outside=False) for seed in range(150)) <= 2


def test_two_false_corners_halfway_make_a_false_row():
    """What misleads where no 3 × 3 fits: (4, ½) and (5, ½) make cells of half the height, whose mean edge is 15/20 of a
    square's, but 1 of each other's."""
    xy, ij = points(7, 2)
    false = np.array([[380.0, 310], [400, 310]])
    first = recovered(np.concatenate([xy, false]), first=4)[0]
    assert sorted(first.values()) == [4, 5, 11, 12, 14, 15]
    assert not consistent({spot: c for spot, c in first.items() if c < 14}, ij)


@pytest.mark.parametrize("name", ["flat", "noisy", "small", "negative", "cylinder", "wave"])
def test_boards_in_pictures_are_labelled_as_the_graph_labels_them(name):
    """With axes, histograms and colours from the picture: the same corner is (0, 0), and `orientation` is the same."""
    shown = view(name)
    given_ = shown.candidates()
    (mine,), (other,) = find_boards_paper(shown.grey, given_), find_boards(shown.grey, given_)
    for key in ("xy", "ij", "response", "status"):
        assert np.array_equal(getattr(mine, key), getattr(other, key)), key
    assert (mine.orientation, mine.image_size) == (other.orientation, other.image_size)


@pytest.mark.parametrize("name", VIEWS)
def test_no_wrong_label_in_pictures_without_clutter(name):
    shown = view(name)
    found = find_boards_paper(shown.grey, shown.candidates())
    assert sum(map(shown.wrong, found)) == 0
    assert all(map(right_handed, found))
    assert sum(map(len, found)) >= 0.9 * len(shown)
    assert [len(b) for b in found] == sorted((len(b) for b in found), reverse=True)


def test_several_boards_come_largest_first():
    boards = tuple(board(c, 4, 20, 5, 10, at=at) for c, at in ((4, (-120, -80)), (7, (110, 80)), (5, (-120, 80))))
    shown = View(scene(boards=boards))
    found = find_boards_paper(shown.grey, shown.candidates())
    assert [len(b) for b in found] == [28, 20, 16]
    assert sum(map(shown.wrong, found)) == 0


@pytest.mark.parametrize("name", ["tilted", "fisheye"])
def test_the_order_of_the_candidates_doesn_t_matter(name):
    shown = view(name)
    straight = shown.candidates(extra=clutter(shown, 40, 1), response=np.full(len(shown) + 40, 0.9))
    rng = np.random.default_rng(0)
    for _ in range(3):
        mixed = rng.permutation(len(straight.all))
        turned = type(straight)(
            straight.all.take(mixed),
            type(straight.orientation)(*(v[mixed] for v in vars(straight.orientation).values())),
            straight.sure[mixed],
            straight.seed[mixed],
        )
        one, other = find_boards_paper(shown.grey, straight), find_boards_paper(shown.grey, turned)
        assert len(one) == len(other) > 0
        for a, b in zip(one, other, strict=True):
            assert a.xy.tobytes() == b.xy.tobytes()
            assert a.ij.tobytes() == b.ij.tobytes()


def test_corners_below_the_threshold_stay_out():
    shown = view("flat")
    found = find_boards_paper(shown.grey, shown.candidates(weak=[0]))
    assert shown.index(0, 0) == 0
    assert 0 not in {k for b in found for k in shown.number(b.xy)}


@pytest.mark.parametrize("count", [0, 1, 3])
def test_fewer_than_four_corners_are_no_board(count):
    grey = np.zeros((60, 60), np.uint8)
    xy = np.array([[20.0, 20], [40, 20], [20, 40]])[:count]
    assert find_boards_paper(grey, candidates(grey, xy, np.full(count, 0.9), np.ones(count, bool))) == []


def test_the_least_number_of_corners():
    shown = view("flat")
    assert len(find_boards_paper(shown.grey, shown.candidates(), 35)) == 1
    assert find_boards_paper(shown.grey, shown.candidates(), 36) == []


def test_four_corners_are_a_board():
    shown = view(cols=2, rows=2, tilt=10)
    (found,) = find_boards_paper(shown.grey, shown.candidates())
    assert (found.size, found.orientation) == ((2, 2), "ambiguous_90")
    assert shown.wrong(found) == 0


def test_the_setting_chooses(monkeypatch):
    assert (DetectorConfig().recovery, DetectorConfig.paper().recovery) == ("graph", "growth")
    with pytest.raises(ConfigError, match="recovery"):
        DetectorConfig(recovery="lines")
    calls = []
    monkeypatch.setattr("rcdn.views.find_boards_paper", lambda *a: calls.append("growth") or [])
    monkeypatch.setattr("rcdn.views.find_boards", lambda *a: calls.append("graph") or [])
    for recovery in ("growth", "graph"):
        Detector(DetectorConfig(recovery=recovery)).detect(np.zeros((40, 40), np.uint8))
    assert list(dict.fromkeys(calls)) == ["growth", "graph"]  # each may look at several views

"""Geiger's detector: likelihood, corners, boards on rendered scenes with exact truth."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rcdn.metrics import match
from rcdn_lab.peers import PEERS, geiger_corners
from rcdn_lab.peers.geiger import geiger_boards
from rcdn_lab.peers.geiger_corners import GeigerCorners, corner_likelihood
from rcdn_lab.peers.labels import labelled
from rcdn_lab.peers.maxima import local_maxima
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.score import Answers, score
from rcdn_lab.sweep.settings import BASE

FIND = PEERS["geiger"].load()
SIZE = (9, 6)
SCENES = {
    "clean": {"noise": 0.0, "tilt": 5.0},
    "noise 5": {"noise": 5.0},
    "tilt 45": {"tilt": 45.0, "noise": 5.0},
    "barrel": {"barrel": 0.5, "noise": 5.0},
    "small squares": {"square": 12.0},
}


def judged(made):
    grids = FIND(made.image, SIZE)
    return grids, score(grids, Answers(made.boards, [np.ones(len(b.xy)) for b in made.boards]))


def printed(made):
    """Labels of the true corners with a dark square inside (0, 0)."""
    ij = made.boards[0].ij
    return ij.max(axis=0) - ij if made.scene.boards[0].swap else ij


def half_planes(side=41, degrees=0.0, crossing=True):
    """An X-corner, or an edge, in the middle: float32 in 0..1."""
    axis = np.arange(side) - side // 2
    x, y = np.meshgrid(axis, axis)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    a = np.clip(x * c + y * s, -0.5, 0.5)
    b = np.clip(y * c - x * s, -0.5, 0.5) if crossing else 0.5
    return (0.5 + 2 * a * b).astype(np.float32)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", range(2))
def test_whole_boards_with_right_labels(name, seed):
    grids, done = judged(picture(replace(BASE, **SCENES[name]), [21, seed], SIZE))
    assert done.success, (done.hits, done.wrong, done.mislabelled, len(grids))
    assert done.gap.mean() < 0.1


def test_a_clean_board_is_precise():
    _, done = judged(picture(replace(BASE, noise=0.0, square=30, tilt=5.0), [22, 0], SIZE))
    assert done.gap.mean() < 0.04
    assert done.gap.max() < 0.15


@pytest.mark.parametrize("seed", range(3))
def test_labels_are_the_printed_ones(seed):
    """Columns and rows of 9 × 6 differ in parity: colours settle each label (docs/conventions.md)."""
    made = picture(replace(BASE, noise=2.0), [23, seed], SIZE)
    (grid,) = FIND(made.image, SIZE)
    pairs, _ = match(grid.xy, made.boards[0].xy, 2)
    assert np.array_equal(grid.ij[pairs[:, 0]], printed(made)[pairs[:, 1]])
    assert np.array_equal(np.lexsort((grid.ij[:, 0], grid.ij[:, 1])), np.arange(54))


def test_several_boards():
    grids, done = judged(picture(replace(BASE, boards=3), [24, 0], SIZE))
    assert len(grids) == 3
    assert done.success


@pytest.mark.parametrize("kind", ["plain", "noise", "shapes", "text"])
def test_no_board_in_clutter(kind):
    made = picture(replace(BASE, boards=0, clutter=kind), [25, 0], SIZE)
    assert FIND(made.image, SIZE) == []


def test_one_picture_one_answer():
    made = picture(replace(BASE, noise=10.0), [26, 0], SIZE)
    one, two = FIND(made.image, SIZE), FIND(made.image.copy(), SIZE)
    assert [g.xy.tobytes() for g in one] == [g.xy.tobytes() for g in two]


@pytest.mark.parametrize("degrees", [0, 20, 45, 70])
def test_likelihood_of_corners_and_edges(degrees):
    """The two prototypes are 45° apart: none is further than 22.5° from a corner of right angles.
    Colours make no difference."""
    likely = corner_likelihood(half_planes(degrees=degrees))
    assert likely[20, 20] == likely.max() > 0.2
    assert np.allclose(corner_likelihood(1 - half_planes(degrees=degrees)), likely, atol=1e-5)
    edge = corner_likelihood(half_planes(81, degrees, crossing=False))
    inside = edge[14:-14, 14:-14]  # at the border the edge and its reflection make corners
    assert inside.max() < geiger_corners.LEAST_LIKELIHOOD


def test_likelihood_by_hand():
    """A, B, C, D = 1, 1, 0, 0 for an ideal corner: μ = ½, and each of the four terms is ½."""
    kernels = geiger_corners._kernels(4)[0]
    assert np.allclose(kernels.sum(axis=(1, 2)), 1)
    ideal = (half_planes(9) * 2).round() / 2
    assert np.allclose(sorted((kernels * ideal).sum(axis=(1, 2))), [0, 0, 1, 1])
    assert corner_likelihood(half_planes())[20, 20] == pytest.approx(0.5)


def test_a_corner_is_found_with_its_directions():
    fine = cv2.resize(half_planes(205, 25.0), (41, 41), interpolation=cv2.INTER_AREA)
    grey = np.rint(40 + 150 * fine).astype(np.uint8)
    found = geiger_corners.geiger_corners(grey)
    near = np.linalg.norm(found.xy - 20, axis=1) < 1
    assert near.sum() == 1
    assert np.linalg.norm(found.xy[near] - 20) < 0.05
    assert np.degrees(found.angles[near][0]) == pytest.approx([25, 115], abs=2)  # Sobel's own error on a sharp edge


def test_only_the_likeliest_corners_are_looked_at(monkeypatch):
    """This bounds the time on texture."""
    made = picture(BASE, [27, 0], SIZE)
    monkeypatch.setattr(geiger_corners, "MOST_CORNERS", 20)
    assert 10 < len(geiger_corners.geiger_corners(made.image).xy) <= 20


def points(cols, rows, at):
    return np.stack(np.meshgrid(np.arange(cols), np.arange(rows)), axis=-1).reshape(-1, 2) * 20.0 + at


def corners_at(xy):
    return GeigerCorners(xy, np.tile([0.0, np.pi / 2], (len(xy), 1)), np.linspace(1, 0.5, len(xy)))


def test_boards_of_lattices():
    """The one of less energy, which has more corners, comes first; eight corners are none;
    no corner is in two boards."""
    xy = np.concatenate([points(4, 4, (0, 0)), points(7, 5, (200, 0)), points(4, 2, (0, 300))])
    boards = geiger_boards(corners_at(xy))
    assert sorted(boards[0].ravel().tolist()) == list(range(16, 51))
    assert sorted(boards[1].ravel().tolist()) == list(range(16))
    assert len(boards) == 2


def test_a_board_needs_an_energy_of_minus_ten():
    """3 × 3 corners have −9 at the best, 4 × 3 have −12."""
    assert geiger_boards(corners_at(points(3, 3, (0, 0)))) == []
    (board,) = geiger_boards(corners_at(points(4, 3, (0, 0))))
    assert board.size == 12


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("mirror", [False, True])
def test_labels_do_not_depend_on_how_a_lattice_lies_in_memory(turn, mirror):
    """Also a mirrored one comes out right-handed."""
    made = picture(replace(BASE, noise=0.0), [28, 0], SIZE)
    truth = made.boards[0].xy.reshape(6, 9, 2)
    grid = labelled(made.image, np.rot90(truth[:, ::-1] if mirror else truth, turn))
    pairs, gaps = match(grid.xy, made.boards[0].xy, 0.1)
    assert gaps.tolist() == [0] * 54
    assert np.array_equal(grid.ij[pairs[:, 0]], printed(made)[pairs[:, 1]])


def test_maxima_of_windows():
    """The largest of 7 × 7; of equals the first; nothing below the limit; nothing that isn't positive."""
    made = np.zeros((30, 30), np.float32)
    made[5, 5], made[5, 8], made[5, 9] = 3, 2, 1
    made[20, 10], made[20, 12], made[22, 14] = 4, 4, 4
    assert local_maxima(made, 3, 0).tolist() == [[5, 5], [10, 20], [14, 22]]
    assert local_maxima(made, 3, 3.5).tolist() == [[10, 20], [14, 22]]
    assert len(local_maxima(np.zeros((9, 9), np.float32), 3, 0)) == 0

"""Clustering: strays go, the board stays, and the result depends on the input only."""

import numpy as np
import pytest

from rcdn.config import Cluster
from rcdn.corners import cluster
from rcdn.corners.cluster import cluster_mask, kmeans

GRID = np.stack(np.meshgrid(np.arange(9), np.arange(6)), axis=-1).reshape(-1, 2) * 30.0 + 200
STRAYS = np.array([[1500.0, 40], [30, 1100], [1550, 1120]])


def test_far_strays_go_and_the_board_stays():
    mask = cluster_mask(np.concatenate((GRID, STRAYS)), Cluster())
    assert mask[: len(GRID)].all()
    assert not mask[len(GRID) :].any()


@pytest.mark.parametrize("n", [0, 1, 29])
def test_few_corners_all_stay(n):
    xy = np.concatenate((STRAYS, GRID))[:n]
    assert cluster_mask(xy, Cluster()).tolist() == [True] * n


def test_same_input_same_mask():
    xy = np.random.default_rng(3).uniform(0, 500, (80, 2))
    assert np.array_equal(cluster_mask(xy, Cluster()), cluster_mask(xy.copy(), Cluster()))


def test_a_pair_goes():
    mask = cluster_mask(np.concatenate((GRID, STRAYS[:1], STRAYS[:1] + 2)), Cluster())
    assert mask.tolist() == [True] * len(GRID) + [False] * 2


def test_clusters_above_the_limit_stay():
    xy = np.concatenate((GRID, STRAYS[:1] + np.array([[0, 0], [3, 0], [0, 3]])))
    assert cluster_mask(xy, Cluster()).all()


def test_equal_points_and_fewer_points_than_clusters():
    assert cluster_mask(np.full((40, 2), 7.0), Cluster()).all()
    assert not cluster_mask(np.array([[0.0, 0], [50, 0], [0, 90]]), Cluster(least=2)).any()


def test_kmeans_finds_separate_blobs():
    rng = np.random.default_rng(1)
    centres = rng.uniform(0, 1000, (10, 2))
    truth = np.repeat(np.arange(10), 12)
    label = kmeans(centres[truth] + rng.normal(0, 2, (120, 2)), 10, seed=0)
    assert len({(a, b) for a, b in zip(truth, label, strict=True)}) == 10


def plain_seeding(xy, k, rng):
    """k-means++ as first published: each next centre is one point, drawn by squared distance."""
    picks = [int(rng.integers(len(xy)))]
    while len(picks) < k:
        nearest = ((xy[:, None] - xy[picks]) ** 2).sum(axis=2).min(axis=1)
        picks.append(int(rng.choice(len(xy), p=nearest / nearest.sum())))
    return xy[picks]


def test_greedy_seeding_leads_to_better_optima(monkeypatch):
    rng = np.random.default_rng(5)
    boards = [GRID @ rng.normal(0, 1, (2, 2)) + rng.normal(0, 0.5, GRID.shape) for _ in range(40)]

    def spread(xy):
        label = kmeans(xy, 10, seed=0)
        return sum(float(((xy[label == k] - xy[label == k].mean(axis=0)) ** 2).sum()) for k in np.unique(label))

    greedy = [spread(xy) for xy in boards]
    monkeypatch.setattr(cluster, "_plus_plus", plain_seeding)
    plain = [spread(xy) for xy in boards]
    assert np.exp(np.mean(np.log(greedy) - np.log(plain))) < 0.996

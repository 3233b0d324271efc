"""MATE: what it makes of a response, and what it says while its weights aren't there."""

import numpy as np
import pytest

from rcdn.config import Fixed
from rcdn.metrics import match
from rcdn_lab import table_weights
from rcdn_lab.peers import PEERS, mate
from rcdn_lab.peers.mate import mate_corners
from rcdn_lab.sweep import picture
from rcdn_lab.sweep.settings import BASE

SPOTS = np.array([[20.3, 30.1], [45.0, 30.4], [70.4, 29.6], [20.2, 60.0], [44.7, 59.8], [70.0, 60.3]])
FAINT = np.array([[90.0, 80.0]])


def respond(grey):
    """Gaussian peaks at `SPOTS`, of 1.5, and at `FAINT`, of 0.6."""
    y, x = np.indices(grey.shape)
    peak = lambda xy: np.exp(-((x - xy[0]) ** 2 + (y - xy[1]) ** 2) / (2 * 1.2**2))  # noqa: E731
    return (1.5 * sum(map(peak, SPOTS)) + 0.6 * sum(map(peak, FAINT))).astype(np.float32)


@pytest.mark.parametrize(("threshold", "expected"), [(None, SPOTS), (Fixed(0.5), np.concatenate([SPOTS, FAINT]))])
def test_peaks_of_the_response(threshold, expected):
    """The adaptive threshold is the mean of the responses above 0.5, here about 0.9; MATE's own is 0.5."""
    xy, score = mate_corners(respond, np.zeros((100, 110), np.uint8), threshold)
    assert len(xy) == len(expected)
    pairs, gaps = match(xy, expected, 2)
    assert len(pairs) == len(expected)
    assert gaps.max() < 0.01
    assert (np.diff(score) <= 0).all()


def test_it_says_what_it_lacks(monkeypatch, tmp_path):
    monkeypatch.setattr(table_weights, "FOLDER", tmp_path)
    assert "tables/mate.onnx" in PEERS["mate"].missing()
    (tmp_path / "mate.onnx").touch()
    assert "tables/mate.json" in PEERS["mate"].missing()
    (tmp_path / "mate.json").touch()
    assert PEERS["mate"].missing() is None


def test_the_peer_runs_a_network(monkeypatch):
    """With the weights of F in the place of its own."""
    monkeypatch.setattr(mate, "WEIGHTS", "rcdn_f")
    made = picture(BASE, [12, 0])
    find = PEERS["mate"].load()
    (grid,) = find(made.image, (9, 6))
    assert grid.ij is None
    pairs, gaps = match(grid.xy, made.boards[0].xy, 3)
    assert len(pairs) == 54
    assert gaps.mean() < 0.5
    assert find(np.full((100, 120), 128, np.uint8), (9, 6)) == []

"""Peaks of a map that is 0 outside of some cells: looking only there changes nothing."""

from dataclasses import replace

import numpy as np
import pytest

from rcdn.config import Adaptive, DetectorConfig, Fixed, MaxFraction, Std
from rcdn.corners import find_maxima
from rcdn.corners.sieve import CELL, every_cell

AUTO, PAPER = DetectorConfig(), DetectorConfig.paper()
RULES = {
    "auto": AUTO,
    "paper": PAPER,
    "low level": replace(AUTO, threshold=Adaptive(0.1), weak=0.5),
    "fixed": replace(AUTO, threshold=Fixed(0.4)),
    "deviations": replace(AUTO, threshold=Std(2.0)),
    "share": replace(AUTO, threshold=MaxFraction(0.4)),
    "all": replace(AUTO, threshold=Fixed(0.0), border=0),
    "below nothing": replace(AUTO, threshold=Adaptive(-1.0)),
}
SIZES = [(61, 83), (64, 80), (4, 4), (1, 1), (3, 50), (5, 9)]


def smooth(size, seed, top=1.0):
    """A map of bumps in 0..top."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: size[0], : size[1]]
    out = 0.05 * rng.random(size)
    for _ in range(3 + size[0] * size[1] // 150):
        at, high = rng.random(2) * size, rng.uniform(0.05, 1)
        out = np.maximum(out, high * np.exp(-((y - at[0]) ** 2 + (x - at[1]) ** 2) / 5))
    return (top * out).astype(np.float32)


def blanked(response, cells):
    seen = np.kron(cells, np.ones((CELL, CELL), bool))[: response.shape[0], : response.shape[1]]
    return np.where(seen, response, np.float32(0))


def assert_same(found, known):
    assert found.xy.tolist() == known.xy.tolist()
    assert found.score.tobytes() == known.score.tobytes()
    assert (found.level, found.rescued) == (known.level, known.rescued)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("size", SIZES)
def test_cells_change_nothing(rule, size):
    count = 0
    for seed, share in enumerate([0.0, 0.03, 0.3, 0.7, 1.0]):
        cells = np.random.default_rng(seed).random(every_cell(np.zeros(size)).shape) < share
        for top in (1.0, 0.3):  # above the usual level, and a map that may be rescued
            response = blanked(smooth(size, seed, top), cells)
            known = find_maxima(response, RULES[rule])
            assert_same(find_maxima(response, RULES[rule], cells), known)
            count += len(known.xy)
    assert count > 15 or min(size) < 20


def test_peaks_outside_of_the_cells_are_not_looked_at():
    response = smooth((61, 83), 3)
    cells = np.random.default_rng(4).random((16, 21)) < 0.5
    found = find_maxima(response, AUTO, cells)
    assert len(found.xy) > 3
    assert cells[found.xy[:, 1] // CELL, found.xy[:, 0] // CELL].all()
    assert len(found.xy) < len(find_maxima(response, AUTO).xy)


def test_a_peak_at_the_rim_of_a_cell_knows_its_neighbours():
    """A peak in a cell is one only if no pixel beside it is higher, marked or not."""
    response = np.zeros((20, 20), np.float32)
    response[8, 7:9] = 0.8, 0.9
    cells = np.zeros((5, 5), bool)
    cells[2, 1] = True
    config = replace(AUTO, threshold=Fixed(0.5), nms=replace(AUTO.nms, peaks=True), border=0)
    assert len(find_maxima(response, config, cells).xy) == 0
    cells[2, 2] = True
    assert find_maxima(response, config, cells).xy.tolist() == [[8, 8]]


@pytest.mark.parametrize("cells", [None, np.zeros((16, 21), bool), np.ones((16, 21), bool)], ids=["none", "no", "all"])
def test_nothing_is_found_where_there_is_nothing(cells):
    for rule in ("auto", "paper"):
        found = find_maxima(np.zeros((61, 83), np.float32), RULES[rule], cells)
        assert (len(found.xy), len(found.score), found.level) == (0, 0, np.inf)


def test_strong_peaks_and_those_taken():
    found = find_maxima(smooth((61, 83), 5), AUTO)
    assert (np.diff(found.score) <= 0).all()
    strong = found.take(found.strong(AUTO))
    assert (strong.score >= found.level * AUTO.seed).all()
    assert 0 < len(strong.xy) <= len(found.xy)
    assert (strong.level, strong.rescued) == (found.level, found.rescued)
    assert found.take(np.array([1, 0])).xy.tolist() == found.xy[[1, 0]].tolist()


def test_a_faint_map_is_rescued_only_where_its_top_stands_out():
    lone = np.zeros((60, 60), np.float32)
    lone[30, 30] = 0.3
    found = find_maxima(lone, AUTO, blanked(np.ones((15, 15)), np.ones((4, 4), bool)) > 0)
    assert found.rescued
    assert found.xy.tolist() == [[30, 30]]
    assert found.level == pytest.approx(0.41 * 0.3)
    assert not len(find_maxima(np.maximum(lone, 0.02), AUTO).xy)  # everything comes within 20 times of the top
    assert not len(find_maxima(lone / 3, AUTO).xy)

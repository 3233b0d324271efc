"""Flood fill over triangles against a slow version, on lattices that are torn, doubled and miscoloured."""

import heapq

import numpy as np
import pytest

from rcdn.boards.graph import flood, linked_cells
from rcdn.geometry.rules import CHECKER, TRIANGLES
from rcdn.types.plane import plane_points


def labels_of(where, triangle):
    """Labels of a triangle's corners from two known ones: the third lies a third of a turn further on."""
    for k in range(3):
        a, b = triangle[k], triangle[(k + 1) % 3]
        if a in where and b in where:
            (u, v), (p, q) = where[a], where[b]
            du, dv = p - u, q - v
            if (du, dv) not in TRIANGLES.steps:
                return None
            out = [(u, v), (p, q), (u - dv, v + du + dv)]
            return out[-k % 3], out[(1 - k) % 3], out[(2 - k) % 3]
    return None


def slow(response, found, colours):
    """Lattices, the surest triangle first; one that contradicts may be tried again from another side."""
    score = [float(response[list(t)].min()) for t in found]
    beyond = {(t[k], t[(k + 1) % 3]): n for n, t in enumerate(found) for k in range(3)}
    used, grids = [False] * len(found), []
    for seed in sorted(range(len(found)), key=lambda n: (-score[n], n)):
        if used[seed]:
            continue
        at, where, sign, heap = {}, {}, colours[seed], [(-score[seed], seed)]
        while heap:
            n = heapq.heappop(heap)[1]
            spots = labels_of(where, found[n]) if at else ((0, 0), (1, 0), (0, 1))
            if used[n] or spots is None:
                continue
            way = TRIANGLES.steps.index((spots[1][0] - spots[0][0], spots[1][1] - spots[0][1]))
            clash = any(at.get(s, c) != c or where.get(c, s) != s for c, s in zip(found[n], spots, strict=True))
            if clash or colours[n] != sign * (-1) ** way:
                continue
            used[n] = True
            for corner, spot in zip(found[n], spots, strict=True):
                at[spot], where[corner] = corner, spot
            for k in range(3):
                other = beyond.get((found[n][(k + 1) % 3], found[n][k]))
                if other is not None and not used[other]:
                    heapq.heappush(heap, (-score[other], other))
        grids.append((at, sign))
    return grids


def torn_lattice(seed):
    """Triangles of a lattice, some missing, with a wrong corner, of the wrong colour, or beside a rival."""
    rng = np.random.default_rng(seed)
    number = rng.permutation(72).reshape(9, 8)
    found = []
    for u in range(8):
        for v in range(7):
            found += [((number[u, v], number[u + 1, v], number[u, v + 1]), 1)]
            found += [((number[u + 1, v], number[u + 1, v + 1], number[u, v + 1]), -1)]
    out = {}
    for triangle, colour in found:
        if rng.random() < 0.1:
            continue
        ring = [int(c) for c in triangle]
        out[tuple(np.roll(ring, -int(np.argmin(ring))).tolist())] = -colour if rng.random() < 0.05 else colour
        if rng.random() < 0.15:
            ring[rng.integers(3)] = int(rng.integers(72))
            if len(set(ring)) == 3:
                out[tuple(np.roll(ring, -int(np.argmin(ring))).tolist())] = int(rng.choice([-1, 1]))
    cells = np.array(sorted(out), np.int64)
    response = np.round(rng.random(72), 1)  # many are equal
    return response, cells, np.array([out[tuple(t)] for t in cells.tolist()], np.int64)


@pytest.mark.parametrize("seed", range(60))
def test_triangles_are_labelled_as_by_the_slow_version(seed):
    response, found, colours = torn_lattice(seed)
    got = flood(response, found, colours, TRIANGLES)
    expected = slow(response, [tuple(t) for t in found.tolist()], colours.tolist())
    assert [list(at.items()) for at, _ in got] == [list(at.items()) for at, _ in expected]
    assert [sign for _, sign in got] == [sign for _, sign in expected]
    assert len(expected) > 1


@pytest.mark.parametrize("rule", [CHECKER, TRIANGLES], ids=lambda rule: rule.pattern)
def test_cells_of_a_whole_lattice_of_links(rule):
    ij = np.array([(u, v) for u in range(6) for v in range(5)])
    at = {tuple(spot): k for k, spot in enumerate(ij.tolist())}
    links = np.array([[at.get((u + d, v + e), -1) for d, e in rule.steps] for u, v in ij.tolist()])
    found = linked_cells(20 * plane_points(ij, rule.pattern), links, rule, 2.5)
    assert len(found) == 5 * 4 * len(rule.cells)
    whole = {(at[u, v], *(at.get((u + d, v + e), -1) for d, e in ring)) for u, v in at for ring in rule.cells}
    assert {frozenset(cell) for cell in found.tolist()} == {frozenset(cell) for cell in whole if -1 not in cell}
    ways = [rule.steps.index(tuple(step)) for step in (ij[found[:, 1]] - ij[found[:, 0]]).tolist()]
    colours = np.array([0 if rule is CHECKER else (-1) ** way for way in ways], np.int64)
    ((grid, sign),) = flood(np.ones(len(ij)), found, colours, rule)
    assert sorted(grid.values()) == list(range(len(ij)))
    assert sign == colours[0]
    own = np.array(list(grid))
    turned = [rule.turned(ij[list(grid.values())], k) for k in range(len(rule.steps))]
    assert any(len(np.unique(own - other, axis=0)) == 1 for other in turned)

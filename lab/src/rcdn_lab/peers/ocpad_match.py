"""The match of OCPAD (Fürsattel et al., WACV 2016): part of a picture's saddle graph as a part of the board's graph, by
the search of VF2 (Cordella et al. 2004).

Decided here, because a board is a drawing and not only a graph: links of the board may be missing in the picture
(monomorphism), a match keeps the cyclic order of the links around a vertex and continues lines, and the vertices that
the bisection left out are added where they fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product

import numpy as np

from rcdn.types import Array

STRAIGHT = -0.7
"""Largest cosine between the links to two opposite neighbours."""
FLAT = 0.1
"""Least sine between the links to two neighbours that are not opposite."""
MOST_STEPS = 20_000
"""Assignments tried in one search; a search that needs more has failed."""
Spot = tuple[int, int]
Match = dict[int, Spot]
"""vertex of the picture's graph → column and row of the board"""
TURNS: tuple[Spot, ...] = ((1, 0), (0, 1), (-1, 0), (0, -1))


def match_part(xy: Array, near: Mapping[int, set[int]], order: Sequence[int], size: tuple[int, int]) -> Match:
    """The match of as many vertices as possible with a board of `size` (columns, rows).

    `xy` (N, 2) px; `near`: linked vertices; `order`: the vertices by distance from the anchor. A bisection
    finds how many of them match. Fewer can be at several places of the board, and a frame around it adds vertices
    that are not on it: of all places the one that lets most others follow, and then the one with most links, as in
    ROCHADE. Empty if even two vertices have no match.
    """
    search, most = Search(xy, near, size), min(len(order), size[0] * size[1])
    step = count = most
    counts: list[int] = []
    while step and most not in counts:
        found = next(search.matches(order[:count]), None) is not None
        counts += [count] * found
        step //= 2
        count = min(most, max(2, count + (step if found else -step)))
    if most not in counts:  # the nearest vertices of a frame may be among those that match
        counts.append(max(2, min(counts, default=2) // 2))
    whole: tuple[int, int, Match] = (0, 0, {})
    for match in (m for count in sorted(counts, reverse=True) for m in search.matches(order[:count])):
        grown = search.extended(match, order)
        rank = len(grown), sum(len(near[v]) for v in grown)
        whole = (*rank, grown) if rank > whole[:2] else whole
        if rank[0] == len(order):
            break
    return whole[2]


class Search:
    """Matches of vertices of one graph with a board of `size` (columns, rows)."""

    def __init__(self, xy: Array, near: Mapping[int, set[int]], size: tuple[int, int]) -> None:
        self.near, self.size = near, size
        self.toward = {
            (a, b): (xy[b] - xy[a]) / max(float(np.linalg.norm(xy[b] - xy[a])), 1e-9) for a in near for b in near[a]
        }

    def matches(self, order: Sequence[int]) -> Iterator[Match]:
        """The matches of all of `order`, in which each vertex but the first is linked with an earlier one, until
        `MOST_STEPS` are done."""
        at, taken, steps = Match(), dict[Spot, int](), 0
        stack: list[Iterator[Spot]] = [iter(product(range(self.size[0]), range(self.size[1])))]
        while stack:
            vertex = order[len(stack) - 1]
            taken.pop(at.pop(vertex, (-1, -1)), None)
            spot = next((s for s in stack[-1] if self.fits(vertex, s, at, taken)), None)
            if spot is None:
                stack.pop()
                continue
            at[vertex], taken[spot] = spot, vertex
            steps += 1
            if steps > MOST_STEPS:
                return
            if len(at) == len(order):
                yield dict(at)
            else:
                stack.append(iter(self.candidates(order[len(stack)], at)))

    def candidates(self, vertex: int, at: Match) -> list[Spot]:
        """Places next to those of the vertices linked with `vertex`."""
        first = next(at[b] for b in sorted(self.near[vertex]) if b in at)
        return [(first[0] + du, first[1] + dv) for du, dv in TURNS]

    def fits(self, vertex: int, spot: Spot, at: Match, taken: Mapping[Spot, int]) -> bool:
        """Whether `vertex` may be at `spot`: free, on the board, next to all linked vertices, and in their order."""
        if spot in taken or not (0 <= spot[0] < self.size[0] and 0 <= spot[1] < self.size[1]):
            return False
        linked = {b: at[b] for b in self.near[vertex] if b in at}
        if any(abs(spot[0] - u) + abs(spot[1] - v) != 1 for u, v in linked.values()):
            return False
        return self._in_order(vertex, spot, linked) and all(
            self._in_order(b, at[b], {c: at[c] for c in self.near[b] if c in at} | {vertex: spot}) for b in linked
        )

    def _in_order(self, vertex: int, spot: Spot, linked: Mapping[int, Spot]) -> bool:
        """Whether the links from `vertex` at `spot` to its neighbours at their places turn as the board's do."""
        turn = sorted((TURNS.index((u - spot[0], v - spot[1])), b) for b, (u, v) in linked.items())
        pairs = list(pairwise(turn)) + ([(turn[-1], turn[0])] if len(turn) > 2 else [])
        for (one, a), (other, b) in pairs:
            p, q = self.toward[vertex, a], self.toward[vertex, b]
            between = (other - one) % 4
            if between == 2:
                if p @ q > STRAIGHT:
                    return False
            elif (p[0] * q[1] - p[1] * q[0]) * (2 - between) < FLAT:
                return False
        return True

    def extended(self, at: Match, order: Sequence[int]) -> Match:
        """The match with further vertices, each at the only place that the vertices linked with it leave: first those
        with two such, and one with a single one where there are none."""
        at = dict(at)
        taken = {spot: vertex for vertex, spot in at.items()}
        support = 2
        while support:
            grown = False
            for vertex in order:
                if vertex in at or sum(b in at for b in self.near[vertex]) < support:
                    continue
                spots = [s for s in self.candidates(vertex, at) if self.fits(vertex, s, at, taken)]
                if len(spots) == 1:
                    at[vertex], taken[spots[0]], grown = spots[0], vertex, True
                    if support == 1:
                        break
            support = 2 if grown else support - 1
        return at

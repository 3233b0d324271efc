"""OCPAD (Fürsattel et al., WACV 2016): boards of known size, or a part of one, by a match between the graph of a
picture's saddles and that of the board; our implementation (docs/peers.md).

From the publication: the saddle graph is ROCHADE's; a graph is rejected if it has too few vertices or uneven links;
vertices in no quadrangle are removed, and all but the largest connected component; the vertex with most vertices of
quadrangles within three links is the anchor; the vertices nearest to it, by links, are matched with the board's graph
by VF2, and a bisection finds how many of them can be; corners are refined by ROCHADE's surface fit. Decided here: the
thresholds, and what `ocpad_match` says about the match.
"""

from __future__ import annotations

import cv2
import numpy as np

from rcdn import __version__
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer
from rcdn_lab.peers.labels import labelled
from rcdn_lab.peers.ocpad_match import Match, match_part
from rcdn_lab.peers.rochade import CLOSINGS, refined, views
from rcdn_lab.peers.rochade_graph import EdgeGraph, edge_graph, neighbours

LEAST_SHARE, FEWEST = 0.25, 9
"""A part has at least this share of the board's corners, and at least this number."""
WINDOW = 5.0
"""px; no link of a graph is shorter: the window of the surface fit would contain two corners"""
AROUND = 3
"""links; the neighbourhood in which vertices of quadrangles are counted to choose the anchor"""
ENOUGH = 0.97
"""Share of the board's corners with which no further attempt is made."""
Near = dict[int, set[int]]
"""vertex → the vertices linked with it"""


def ocpad_board(grey: Array, size: tuple[int, int]) -> Array | None:
    """The board of `size` (columns, rows) in `grey` (H, W) uint8, or a part of it: corners (rows, columns, 2) px, NaN
    where missing; None if there is none.

    The best of the attempts, which differ in scale and in the gaps that are closed, as in ROCHADE.
    """
    total = size[0] * size[1]
    least, best = max(FEWEST, LEAST_SHARE * total), None
    for small in views(grey):
        scale = np.array(grey.shape[::-1]) / small.shape[::-1]
        for closing in CLOSINGS:
            xy = part_of(edge_graph(small, closing), size)
            if xy is None:
                continue
            xy = refined(grey, (xy + 0.5) * scale - 0.5)
            count = _count(xy)
            if count >= least and (best is None or count > _count(best)):
                best = xy
        if best is not None and _count(best) > ENOUGH * total:
            break
    return best


def _count(xy: Array) -> int:
    return int(np.isfinite(xy[..., 0]).sum())


def part_of(graph: EdgeGraph, size: tuple[int, int]) -> Array | None:
    """Corners (rows, columns, 2) px of a board of `size` (columns, rows) in a graph, NaN where missing, or None."""
    least = max(FEWEST, LEAST_SHARE * size[0] * size[1])
    if len(graph.xy) < least:
        return None
    near = largest_component(quadrangles_only({k: set(n) for k, n in enumerate(neighbours(graph))}))
    if len(near) < least or not is_even(graph.xy, near):
        return None
    found = match_part(graph.xy, near, by_distance(near, anchor(near)), size)
    return None if len(found) < least else _placed(graph.xy, found, size)


def _placed(xy: Array, found: Match, size: tuple[int, int]) -> Array:
    out = np.full((size[1], size[0], 2), np.nan)
    for vertex, (i, j) in found.items():
        out[j, i] = xy[vertex]
    return out


# ---- the graph before the match


def is_even(xy: Array, near: Near) -> bool:
    """Whether all links are at least `WINDOW` long and their standard deviation is less than their mean."""
    length = [np.linalg.norm(xy[a] - xy[b]) for a, others in near.items() for b in others if a < b]
    return len(length) > 1 and bool(min(length) >= WINDOW and np.std(length, ddof=1) < np.mean(length))


def quadrangles_only(near: Near) -> Near:
    """The links that are a side of a cycle of four, and their vertices. Links count as well as vertices (decided): one
    between two quadrangles may belong to the background."""
    out: Near = {}
    for a, others in near.items():
        for b in others:
            if any((near[c] & others) - {a, b} for c in near[b] - {a}):
                out.setdefault(a, set()).add(b)
    return out


def largest_component(near: Near) -> Near:
    """The connected component with most vertices, the one with the first vertex among equals."""
    left, best = set(near), set[int]()
    for vertex in sorted(near):
        if vertex in left:
            part = set(by_distance(near, vertex))
            left -= part
            best = part if len(part) > len(best) else best
    return {v: near[v] for v in sorted(best)}


def anchor(near: Near) -> int:
    """The vertex with most others within `AROUND` links; the one with most links, then the first among equals."""
    return min(near, key=lambda v: (-len(by_distance(near, v, AROUND)), -len(near[v]), v))


def by_distance(near: Near, start: int, most: int | None = None) -> list[int]:
    """The vertices by number of links from `start`, at most `most`, in a fixed order among equals."""
    seen, ring, out, depth = {start}, [start], [start], 0
    while ring and (most is None or depth < most):
        following = dict.fromkeys(b for a in ring for b in sorted(near[a]) if b not in seen)
        ring, depth = list(following), depth + 1
        seen |= following.keys()
        out += ring
    return out


def _find(image: Array, size: tuple[int, int]) -> list[Grid]:
    xy = ocpad_board(image, size)
    return [] if xy is None else [labelled(image, xy)]


def _load() -> Find:
    cv2.setNumThreads(1)
    return _find


OCPAD = Peer("ocpad", "given", lambda: None, lambda: __version__, _load)

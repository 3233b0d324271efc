"""The graph of a picture's edges by ROCHADE (Placht et al., ECCV 2014): thinned edges, saddles at their junctions,
links (docs/peers.md)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial import cKDTree

from rcdn.corners.saddle import rochade, surface_fit
from rcdn.types import Array

SMOOTH = 0.8
"""σ of the smoothing before the gradient, px"""
NEIGHBOURHOOD = 21
"""side of the neighbourhood for the local threshold, px"""
SHARE = 0.35
"""least gradient of an edge as a share of the largest in the neighbourhood"""
FAINT = 0.06
"""least gradient of any edge as a share of the picture's largest gradients"""
STEEPEST = 99.5
"""percentile of the gradients that is used as the largest"""
MERGE = 1
"""junctions of the thinned edges at most this many px apart are merged"""
SPLIT = 12.0
"""px; two junctions without a saddle at most this far apart may be one crossing of a tilted board, which thinning
splits into two three-way junctions"""
SAME = 2.0
"""saddles closer than this are merged, px"""
HALF = 2
"""half window of the saddle fit that distinguishes crossings from other junctions, px"""
DETOUR, SLACK = 1.4, 4.0
"""largest length of a link: this factor times the straight distance, plus this many px"""
MOST_JUNCTIONS = 5000
"""Most junctions; a picture with more is considered texture, and has no graph."""


@dataclass(frozen=True, eq=False)
class EdgeGraph:
    """Nodes `xy` (N, 2) px and pairs `links` (M, 2), first < second, of nodes connected by an edge."""

    xy: Array
    links: Array


def edge_graph(grey: Array, closing: int) -> EdgeGraph:
    """The graph of `grey` (H, W) uint8; gaps of less than `closing` px are closed, because edges fade where they
    cross."""
    skeleton = thin(edge_mask(grey, closing))
    xy, area = _nodes(grey, skeleton)
    return EdgeGraph(xy, _links(skeleton, xy, area))


def edge_mask(grey: Array, closing: int) -> Array:
    """Pixels (H, W) uint8, 0 or 1, whose gradient (Sobel) is large relative to the picture and to its neighbourhood."""
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTH, borderType=cv2.BORDER_REFLECT_101)
    steep = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0), cv2.Sobel(smooth, cv2.CV_32F, 0, 1))
    local = cv2.dilate(steep, np.ones((NEIGHBOURHOOD, NEIGHBOURHOOD), np.uint8))
    mask = (steep > SHARE * local) & (steep > FAINT * np.percentile(steep, STEEPEST))
    round_ = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (closing, closing))
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, round_))


# ---- thinning


def _neighbours() -> tuple[Array, Array]:
    """For the 256 neighbourhoods: the eight neighbours (256, 8), clockwise from above, and the kernel (3, 3) that
    encodes them."""
    bits = (np.arange(256)[:, None] >> np.arange(8)) & 1
    kernel = np.zeros((3, 3), np.float32)
    kernel[[0, 0, 1, 2, 2, 2, 1, 0], [1, 2, 2, 2, 1, 0, 0, 0]] = 2.0 ** np.arange(8)
    return bits, kernel


_BITS, _KERNEL = _neighbours()
_COUNT = _BITS.sum(axis=1)
_BRANCHES = ((_BITS == 0) & (np.roll(_BITS, -1, axis=1) == 1)).sum(axis=1)
_JUNCTION = ((_BRANCHES >= 3) | (_COUNT >= 5)).astype(np.uint8)


def _removable(triples: tuple[tuple[int, int, int], ...]) -> Array:
    """(256,) uint8: whether a pixel with these neighbours is removed in this half step, if in no triple of neighbours
    all three are set."""
    free = np.all([_BITS[:, t].min(axis=1) == 0 for t in map(list, triples)], axis=0)
    return ((_COUNT >= 2) & (_COUNT <= 6) & (_BRANCHES == 1) & free).astype(np.uint8)


_HALF_STEPS = (_removable(((0, 2, 4), (2, 4, 6))), _removable(((0, 2, 6), (0, 4, 6))))


def thin(mask: Array) -> Array:
    """`mask` (H, W) uint8, 0 or 1, thinned to lines of one pixel: Zhang and Suen 1984, all pixels of a half step at
    once."""
    out = np.array(mask, np.uint8)
    while True:
        gone = 0
        for table in _HALF_STEPS:
            drop = np.asarray(cv2.LUT(_codes(out), table), np.uint8) & out
            gone += int(cv2.countNonZero(drop))
            out -= drop
        if not gone:
            return out


def _codes(mask: Array) -> Array:
    return np.asarray(cv2.filter2D(mask, cv2.CV_8U, _KERNEL, borderType=cv2.BORDER_CONSTANT))


# ---- nodes and links


def _nodes(grey: Array, skeleton: Array) -> tuple[Array, Array]:
    """Saddles (N, 2) px of `grey` where three or more lines meet, and a label map (H, W) of the area around each, from
    1; 0 elsewhere.

    The junctions of one crossing are merged: adjacent ones; of the others without a saddle, pairs that have one between
    them; and those with the same saddle.
    """
    area = np.zeros(skeleton.shape, np.float32)
    junction = np.asarray(cv2.LUT(_codes(skeleton), _JUNCTION), np.uint8) & skeleton
    wide = cv2.dilate(junction, np.ones((2 * MERGE + 1,) * 2, np.uint8))
    count, label, _, centre = cv2.connectedComponentsWithStats(wide, connectivity=8)
    if not 1 < count <= MOST_JUNCTIONS:
        return np.zeros((0, 2)), area
    saddle = _saddles(grey, centre[1:])
    kept = np.flatnonzero(np.isfinite(saddle).all(axis=1))
    node = _merged(saddle[kept])
    number = np.zeros(count, np.float32)
    number[kept + 1] = node + 1
    xy = np.stack([np.bincount(node, c) for c in saddle[kept].T], axis=1) / np.bincount(node)[:, None]
    area = number[label]
    for k, (x, y) in enumerate(np.rint(xy).astype(int).tolist(), start=1):
        cv2.circle(area, (x, y), MERGE + 1, float(k), -1)
    return xy, area


def _saddles(grey: Array, junctions: Array) -> Array:
    """Saddles (N, 2) px of `grey` at, or between two of, the `junctions` (N, 2) px; NaN for those without one."""
    saddle = surface_fit(grey, np.rint(junctions).astype(int), rochade(HALF))
    lost = np.flatnonzero(np.isnan(saddle).any(axis=1))
    if len(lost) < 2:
        return saddle
    gap, near = cKDTree(junctions[lost]).query(junctions[lost], k=2)
    gap, other = gap[:, 1], near[:, 1]
    pair = (other[other] == np.arange(len(lost))) & (gap < SPLIT)
    middle = (junctions[lost] + junctions[lost[other]]) / 2
    saddle[lost[pair]] = surface_fit(grey, np.rint(middle[pair]).astype(int), rochade(HALF))
    return saddle


def _merged(xy: Array) -> Array:
    """Group number (N,) from 0 of each of `xy` (N, 2): points closer than `SAME` are in one group."""
    first = np.arange(len(xy))
    for i, j in sorted(cKDTree(xy).query_pairs(SAME)) if len(xy) else ():
        first[first == first[j]] = first[i]
    return np.unique(first, return_inverse=True)[1].reshape(-1)


def _links(skeleton: Array, xy: Array, area: Array) -> Array:
    """Pairs (M, 2) of nodes connected by a nearly straight piece of the skeleton that touches no third one."""
    line = skeleton & (area == 0).astype(np.uint8)
    count, label = cv2.connectedComponents(line, connectivity=8)
    length = np.bincount(label.ravel(), minlength=count)
    near = cv2.dilate(area, np.ones((3, 3), np.uint8))
    touch = (line > 0) & (near > 0)
    pairs = np.unique(np.stack([label[touch], near[touch].astype(int) - 1], axis=1), axis=0)
    ends = np.bincount(pairs[:, 0], minlength=count) == 2
    pairs = pairs[ends[pairs[:, 0]]]
    a, b, size = pairs[0::2, 1], pairs[1::2, 1], length[pairs[0::2, 0]]
    straight = size <= DETOUR * np.linalg.norm(xy[a] - xy[b], axis=1) + SLACK
    return np.unique(np.stack([a, b], axis=1)[straight], axis=0)


def neighbours(graph: EdgeGraph) -> list[list[int]]:
    """For each node the nodes linked with it, ascending."""
    out: list[list[int]] = [[] for _ in graph.xy]
    for a, b in _both_ways(graph.links):
        out[a].append(b)
    return [sorted(o) for o in out]


def _both_ways(links: Array) -> Iterator[tuple[int, int]]:
    for a, b in links.tolist():
        yield a, b
        yield b, a

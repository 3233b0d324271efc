"""ROCHADE (Placht et al., ECCV 2014): whole boards of known size in the graph of a picture's edges; our implementation
(docs/peers.md)."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import cv2
import numpy as np

from rcdn import __version__
from rcdn.boards.geiger import energy
from rcdn.corners.saddle import rochade, surface_fit
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer
from rcdn_lab.peers.labels import labelled, pitch
from rcdn_lab.peers.rochade_graph import EdgeGraph, edge_graph, neighbours

COARSE = 800
"""px; for the first attempt the picture is halved until its longer side is no longer than this"""
ATTEMPTS = 3
"""attempts, each with half the reduction of the previous one"""
CLOSINGS = (3, 5)
"""px; sizes of the morphological closing of gaps in the edges, in each attempt"""
ALONG, ACROSS = (0.4, 2.2), 0.4
"""Range of a link's component along its direction, in the basis of its node, and largest component across it."""
LEAST_ENERGY = -0.5
"""Largest energy (Geiger et al.) of a board per corner: its lines are nearly straight."""
PITCH_SHARE, HALF = 0.2, (2, 5)
"""half window of the surface fit, as a share of the distance to the next corner, and its limits, px"""
Label = tuple[int, int]


def rochade_board(grey: Array, size: tuple[int, int]) -> Array | None:
    """The board of `size` (columns, rows) in `grey` (H, W) uint8: corners (rows, columns, 2) px; None if there is no
    whole one.

    The result of the first attempt that finds the whole board with a saddle at each corner.
    """
    for small in views(grey):
        scale = np.array(grey.shape[::-1]) / small.shape[::-1]
        for closing in CLOSINGS:
            graph = edge_graph(small, closing)
            nodes = board_in(graph, size)
            if nodes is None:
                continue
            xy = refined(grey, (graph.xy[nodes] + 0.5) * scale - 0.5)
            if np.isfinite(xy).all():
                return xy
    return None


def views(grey: Array) -> Iterator[Array]:
    """`grey` (H, W) uint8, reduced by powers of two for one attempt after the other, the smallest first."""
    reduction = max(0, int(np.ceil(np.log2(max(grey.shape) / COARSE))))
    for level in range(reduction, max(reduction - ATTEMPTS, -1), -1):
        yield cv2.resize(grey, None, fx=0.5**level, fy=0.5**level, interpolation=cv2.INTER_AREA) if level else grey


def board_in(graph: EdgeGraph, size: tuple[int, int]) -> Array | None:
    """Nodes (rows, columns) of a whole board of `size` (columns, rows), in any orientation; None if there is none.

    If a larger lattice contains several, the one whose nodes have most links: corners have four, the frame around a
    board three.
    """
    near = neighbours(graph)
    order = sorted(range(len(near)), key=lambda k: (-len(near[k]), k))
    done: set[int] = set()
    for seed in order:
        if len(near[seed]) != 4 or seed in done:
            continue
        at = _labels(graph.xy, near, seed)
        done.update(at.values())
        if len(at) >= size[0] * size[1]:
            found = _window(graph.xy, near, at, size)
            if found is not None:
                return found
    return None


def _labels(xy: Array, near: list[list[int]], seed: int) -> dict[Label, int]:
    """Nodes by label, propagated along links from `seed`, a node with four links, at (0, 0); assigned nodes and labels
    are kept."""
    at, where = {(0, 0): seed}, {seed: (0, 0)}
    steps = xy[near[seed]] - xy[seed]
    steps = steps[np.argsort(np.arctan2(steps[:, 1], steps[:, 0]))]
    basis = {seed: np.stack([steps[2] - steps[0], steps[3] - steps[1]]) / 2}
    queue = deque([seed])
    while queue:
        node = queue.popleft()
        u, v = where[node]
        turns = _directions(xy[near[node]] - xy[node], basis[node])
        ahead = {spot: other for other, spot in zip(near[node], turns, strict=True) if spot is not None}
        own = _basis(xy, node, ahead, basis[node])
        for (du, dv), other in sorted(ahead.items()):
            spot = (u + du, v + dv)
            if other not in where and spot not in at:
                at[spot], where[other], basis[other] = other, spot, own
                queue.append(other)
    return at


def _directions(steps: Array, basis: Array) -> list[Label | None]:
    """Which of (±1, 0), (0, ±1) each of `steps` (K, 2) is in the `basis` (2, 2) of unit steps (rows); None: neither."""
    if abs(np.linalg.det(basis)) < 1e-6:
        return [None] * len(steps)
    out: list[Label | None] = []
    for a, b in (steps @ np.linalg.inv(basis)).tolist():
        main, other = (a, b) if abs(a) > abs(b) else (b, a)
        ok = ALONG[0] <= abs(main) <= ALONG[1] and abs(other) <= ACROSS
        unit = 1 if main > 0 else -1
        out.append(((unit, 0) if abs(a) > abs(b) else (0, unit)) if ok else None)
    return out


def _basis(xy: Array, node: int, ahead: dict[Label, int], given: Array) -> Array:
    """The basis at a node: along each axis the mean step of its links, or the `given` one if it has none."""
    out = given.copy()
    for axis, (one, other) in enumerate((((1, 0), (-1, 0)), ((0, 1), (0, -1)))):
        steps = [s * (xy[ahead[k]] - xy[node]) for k, s in ((one, 1), (other, -1)) if k in ahead]
        if steps:
            out[axis] = np.mean(steps, axis=0)
    return out


def _window(xy: Array, near: list[list[int]], at: dict[Label, int], size: tuple[int, int]) -> Array | None:
    spots = np.array(list(at))
    index = np.full(np.ptp(spots, axis=0) + 1, -1)
    index[tuple((spots - spots.min(axis=0)).T)] = list(at.values())
    degree = np.array([len(n) for n in near])
    best: tuple[int, Array] | None = None
    for lattice in (index.T, index):  # rows first
        if lattice.shape[0] < size[1] or lattice.shape[1] < size[0]:
            continue
        for part in np.lib.stride_tricks.sliding_window_view(lattice, (size[1], size[0])).reshape(-1, size[1], size[0]):
            if (part < 0).any() or energy(xy[part]) > LEAST_ENERGY * part.size:
                continue
            links = int(degree[part].sum())
            if best is None or links > best[0]:
                best = links, part
    return None if best is None else best[1]


def refined(grey: Array, xy: Array) -> Array:
    """Saddles near corners (rows, columns, 2) px by surface fits with the cone filter; NaN for a corner without one,
    and for one that is NaN."""
    known = np.isfinite(xy).all(axis=2)
    flat, half = xy[known], np.clip(PITCH_SHARE * pitch(xy)[known], *HALF).astype(int)
    found, seeds = np.full(flat.shape, np.nan), np.rint(flat).astype(int)
    for k in np.unique(half).tolist():
        found[half == k] = surface_fit(grey, seeds[half == k], rochade(k))
    out = np.full(xy.shape, np.nan)
    out[known] = found
    return out


def _find(image: Array, size: tuple[int, int]) -> list[Grid]:
    xy = rochade_board(image, size)
    return [] if xy is None else [labelled(image, xy)]


def _load() -> Find:
    cv2.setNumThreads(1)
    return _find


ROCHADE = Peer("rochade", "given", lambda: None, lambda: __version__, _load)

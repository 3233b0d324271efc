"""OCamCalib's corner finder (Rufli, Scaramuzza, Siegwart, IROS 2008): black quadrangles at growing erosion, linked at
their corners to a whole board of known size; our implementation (docs/peers.md).

From the publication: adaptive threshold by the local mean; erosion, kernels cross and rectangle in turn; quadrangles by
polygonal approximation; links by distance, area and the lines through the middles of opposite edges; a corner is the
mean of the two linked ones; quadrangles of other runs are added to the pattern of the best run. Decided here: all
numbers, the labels, and the refinement by cornerSubPix.
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
from scipy.spatial import cKDTree

from rcdn import __version__
from rcdn.boards.geiger import energy
from rcdn.types import Array
from rcdn_lab.peers.base import Find, Grid, Peer
from rcdn_lab.peers.labels import labelled, pitch
from rcdn_lab.peers.opencv import UNTIL

BLOCKS = (0.2, 0.1)
"""windows of the threshold, shares of the picture's shorter side"""
DARKER = 5
"""grey levels by which black is darker than the local mean"""
EROSIONS = 8
"""most erosions by one pixel"""
KERNELS = [cv2.getStructuringElement(kind, (3, 3)) for kind in (cv2.MORPH_CROSS, cv2.MORPH_RECT)]
LEAST_AREA, MOST_QUADS = 12.0, 1500
"""px² of a quadrangle, and the number in a run, above which the picture is considered texture"""
TOLERANCES = (0.02, 0.04, 0.06, 0.08)
"""largest distances of a contour from its quadrangle, shares of its length, tried in turn"""
AREAS = 4.0
"""largest ratio of the areas of two linked quadrangles"""
LEAST_ENERGY = -0.5
"""Largest energy (Geiger et al.) of a board per corner."""


def ocamcalib_board(grey: Array, size: tuple[int, int]) -> Array | None:
    """The whole board of `size` (columns, rows) in `grey` (H, W) uint8: corners (rows, columns, 2) px, or None."""
    for share in BLOCKS:
        block = max(3, int(share * min(grey.shape))) | 1
        kind, white = cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV
        black = cv2.adaptiveThreshold(grey, 255, kind, white, block, DARKER)
        runs: list[Array] = []
        for erosion in range(EROSIONS + 1):
            black = cv2.erode(black, KERNELS[erosion % 2]) if erosion else black
            runs.append(quadrangles(black))
            found = _window(pattern(runs[-1]), size)
            if found is not None:
                return _refined(grey, found)
        best = max(range(len(runs)), key=lambda k: len(pattern(runs[k])))
        found = _window(pattern(_added(runs, best)), size)
        if found is not None:
            return _refined(grey, found)
    return None


def quadrangles(black: Array) -> Array:
    """The convex quadrangles (N, 4, 2) px among the outlines of the regions of `black` (H, W) uint8, clockwise."""
    outlines, tree = cv2.findContours(black, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    out = []
    for k, outline in enumerate(outlines):
        if tree[0, k, 3] >= 0 or cv2.contourArea(outline) < LEAST_AREA:
            continue
        length = cv2.arcLength(outline, True)
        polygons = (cv2.approxPolyDP(outline, max(1.0, t * length), True) for t in TOLERANCES)
        four = next((p[:, 0] for p in polygons if len(p) == 4 and cv2.isContourConvex(p)), None)
        if four is not None and (four.min() > 0 and (four < np.array(black.shape[::-1]) - 1).all()):
            out.append(four if cv2.contourArea(four, True) > 0 else four[::-1])
    return np.array(out if len(out) <= MOST_QUADS else [], float).reshape(-1, 4, 2)


def _added(runs: list[Array], best: int) -> Array:
    """The quadrangles of the best run, and those of the others, nearest erosion first, that lie where it has none."""
    out = runs[best]
    for k in sorted(set(range(len(runs))) - {best}, key=lambda k: abs(k - best)):
        middle, radius = out.mean(axis=1), np.sqrt([cv2.contourArea(q.astype(np.float32)) for q in out])
        for quad in runs[k]:
            if not len(out) or (np.linalg.norm(middle - quad.mean(axis=0), axis=1) > 0.5 * radius).all():
                out = np.concatenate([out, quad[None]])
    return out


def links(quads: Array) -> list[tuple[int, int, int, int]]:
    """Quadrangle, corner, quadrangle, corner of each link; each corner has one at most, the shortest first."""
    if len(quads) < 2:
        return []
    edge = np.linalg.norm(np.roll(quads, -1, axis=1) - quads, axis=2).min(axis=1)
    area = np.array([cv2.contourArea(q.astype(np.float32)) for q in quads])
    flat, out, used = quads.reshape(-1, 2), [], set[int]()
    pairs = cKDTree(flat).query_pairs(float(np.median(edge) * 2), output_type="ndarray")
    gap = np.linalg.norm(flat[pairs[:, 0]] - flat[pairs[:, 1]], axis=1)
    for p, q in pairs[np.lexsort((pairs[:, 1], pairs[:, 0], gap))].tolist():
        a, b = p // 4, q // 4
        near = np.linalg.norm(flat[p] - flat[q]) < min(edge[a], edge[b])
        alike = max(area[a], area[b]) < AREAS * min(area[a], area[b])
        free = a != b and not used & {p, q}
        if free and near and alike and _faces(quads[a], p % 4, flat[q]) and _faces(quads[b], q % 4, flat[p]):
            used |= {p, q}
            out.append((a, p % 4, b, q % 4))
    return out


def _faces(quad: Array, corner: int, other: Array) -> bool:
    """Whether `other` (2,) is on the side of `corner` of both lines through the middles of opposite edges."""
    middle = (quad + np.roll(quad, -1, axis=0)) / 2
    for k in (0, 1):
        along = middle[k + 2] - middle[k]
        sides = [along[0] * (p[1] - middle[k][1]) - along[1] * (p[0] - middle[k][0]) for p in (quad[corner], other)]
        if sides[0] * sides[1] <= 0:
            return False
    return True


AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))


def pattern(quads: Array) -> dict[tuple[int, int], Array]:
    """The corners of the largest group of linked quadrangles: place in the lattice → px, the mean of the two linked."""
    beside: dict[int, list[tuple[int, int, int]]] = {}
    for a, k, b, m in links(quads):
        beside.setdefault(a, []).append((k, b, m))
        beside.setdefault(b, []).append((m, a, k))
    done, best = set[int](), dict[tuple[int, int], Array]()
    for seed in beside:
        if seed in done:
            continue
        cell, queue, corners = {seed: (0, 0, 0)}, deque([seed]), dict[tuple[int, int], Array]()
        while queue:
            a = queue.popleft()
            u, v, turn = cell[a]
            for k, b, m in beside[a]:
                at, back = AROUND[(k + turn) % 4], AROUND[(k + turn + 2) % 4]
                spot = (u + at[0], v + at[1])
                place = (spot[0] - back[0], spot[1] - back[1], (k + turn + 2 - m) % 4)
                if cell.setdefault(b, place) != place:
                    continue
                corners.setdefault(spot, (quads[a, k] + quads[b, m]) / 2)
                if b not in done:
                    done.add(b)
                    queue.append(b)
        best = corners if len(corners) > len(best) else best
    return best


def _window(corners: dict[tuple[int, int], Array], size: tuple[int, int]) -> Array | None:
    """The whole board (rows, columns, 2) of `size` in a pattern, the straightest; None if it has none."""
    if len(corners) < size[0] * size[1]:
        return None
    spots = np.array(list(corners))
    spots -= spots.min(axis=0)
    full = np.full((*(spots.max(axis=0) + 1)[::-1], 2), np.nan)
    full[spots[:, 1], spots[:, 0]] = list(corners.values())
    parts = [
        whole[y : y + size[1], x : x + size[0]]
        for whole in (full, full.transpose(1, 0, 2))
        for y in range(whole.shape[0] - size[1] + 1)
        for x in range(whole.shape[1] - size[0] + 1)
    ]
    parts = [p for p in parts if np.isfinite(p).all() and energy(p) <= LEAST_ENERGY * size[0] * size[1]]
    return min(parts, key=energy, default=None)


def _refined(grey: Array, xy: Array) -> Array:
    """Corners by cornerSubPix, in windows that do not reach the next corner."""
    half = np.clip(0.4 * pitch(xy), 2, 5).astype(int)
    out = xy.astype(np.float32)
    for k in np.unique(half).tolist():
        start = np.array(out[half == k], order="C").reshape(-1, 1, 2)
        out[half == k] = cv2.cornerSubPix(grey, start, (k, k), (-1, -1), UNTIL)[:, 0]
    return out.astype(float)


def _find(image: Array, size: tuple[int, int]) -> list[Grid]:
    xy = ocamcalib_board(image, size)
    return [] if xy is None else [labelled(image, xy)]


def _load() -> Find:
    cv2.setNumThreads(1)
    return _find


OCAMCALIB = Peer("ocamcalib", "given", lambda: None, lambda: __version__, _load)

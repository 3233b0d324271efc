"""Initial poses of the cameras of a rig: shared boards, the spanning tree of the pairs with the most support, and
rotation averaging."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rcdn.calibration.relative_pose import hypotheses, matrix
from rcdn.geometry import rotation
from rcdn.types import Array, Calibration
from rcdn.types.arrays import Real

Key = tuple[str, int]
"""(moment, number of the board's target)"""
Sights = Sequence[Mapping[Key, int]]
"""for each camera, the index of its view of each board that it saw completely"""
ROUNDS = 10
"""number of iterations of averaging"""


@dataclass(frozen=True, eq=False)
class Edge:
    """Cameras `a` < `b` with the `keys` of the boards that both saw, the relative pose with the most support, T_b_a (4,
    4), and its `votes`; `joint`: the boards that agree if both lenses are solved for jointly (`JointPairs`)."""

    a: int
    b: int
    keys: list[Key]
    T: Array
    votes: int
    joint: Collection[Key] = ()


def edges_of(cameras: Sequence[Calibration], sights: Sights) -> list[Edge]:
    """An edge for each pair of cameras whose shared boards agree on their relative pose.

    Half of the boards must agree; where colours leave turns of a board open, at least two.
    """
    edges = []
    for a in range(len(cameras)):
        for b in range(a + 1, len(cameras)):
            keys = [k for k in sights[a] if k in sights[b]]
            if not keys:
                continue
            pairs = [(sights[a][k], sights[b][k]) for k in keys]
            T, votes = hypotheses(cameras[a], cameras[b], pairs).most_agreed()
            least = 1 if cameras[a].orientation == "unique" else 2
            if votes >= max(least, len(keys) / 2):
                edges.append(Edge(a, b, keys, T, votes))
    return edges


def components_of(count: int, edges: Sequence[Edge]) -> list[list[int]]:
    """Connected components of the cameras, the largest first."""
    from scipy.sparse import coo_matrix  # here: reports of single cameras import this module, too
    from scipy.sparse.csgraph import connected_components

    ends = np.array([(e.a, e.b) for e in edges]).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(count, count))
    _, label = connected_components(graph, directed=False)
    parts = [np.flatnonzero(label == k).tolist() for k in range(label.max() + 1)]
    return sorted(parts, key=lambda part: (-len(part), part[0]))


def tree(part: Sequence[int], edges: Sequence[Edge]) -> dict[int, Array]:
    """T_camera_first (4, 4) of each camera of `part` along the maximum spanning tree by votes (Prim)."""
    places = {part[0]: np.eye(4)}
    while len(places) < len(part):
        ready = [e for e in edges if (e.a in places) != (e.b in places)]
        best = max(ready, key=lambda e: e.votes)
        if best.a in places:
            places[best.b] = best.T @ places[best.a]
        else:
            places[best.a] = np.linalg.inv(best.T) @ places[best.b]
    return places


def averaged(places: dict[int, Array], edges: Sequence[Edge]) -> dict[int, Array]:
    """`places` averaged over all edges: rotations by least absolute angles (reweighted), then translations for these
    rotations.

    Chatterjee and Govindu, Efficient and robust large-scale rotation averaging, 2013.
    """
    from scipy.spatial.transform import Rotation

    order = list(places)
    mine = [e for e in edges if e.a in places and e.b in places]
    if len(order) < 3:
        return places
    R = {c: places[c][:3, :3] for c in order}
    for _ in range(ROUNDS):
        gaps = np.array([Rotation.from_matrix(R[e.b].T @ e.T[:3, :3] @ R[e.a]).as_rotvec() for e in mine])
        weight = np.sqrt(np.array([e.votes for e in mine]) / np.maximum(np.linalg.norm(gaps, axis=1), 1e-3))
        steps = _differences(order, mine, weight, gaps)
        R = {c: R[c] @ rotation(steps[k]) for k, c in enumerate(order)}
    centres = {c: -places[c][:3, :3].T @ places[c][:3, 3] for c in order}
    for _ in range(ROUNDS):
        # centre of b − centre of a, in the rig's axes, as measured by the edge
        measured = np.array([-R[e.b].T @ e.T[:3, 3] for e in mine])
        off = measured - np.array([centres[e.b] - centres[e.a] for e in mine])
        weight = np.sqrt(np.array([e.votes for e in mine]) / np.maximum(np.linalg.norm(off, axis=1), 1e-3))
        steps = _differences(order, mine, weight, off)
        centres = {c: centres[c] + steps[k] for k, c in enumerate(order)}
    out = {}
    for c in order:
        out[c] = np.eye(4)
        out[c][:3, :3], out[c][:3, 3] = R[c], -R[c] @ centres[c]
    return out


def _differences(
    order: list[int], edges: Sequence[Edge], weight: Array, measured: Real[Array, "e 3"]
) -> Real[Array, "c 3"]:
    """(C, 3) values, 0 for the first camera, whose differences over the edges fit `measured` (E, 3) by
    weighted least squares."""
    at = {c: k for k, c in enumerate(order)}
    A = np.zeros((len(edges), len(order)))
    for row, e in enumerate(edges):
        A[row, at[e.b]], A[row, at[e.a]] = weight[row], -weight[row]
    out = np.zeros((len(order), 3))
    out[1:] = np.linalg.lstsq(A[:, 1:], measured * weight[:, None], rcond=None)[0]
    return out


@dataclass(frozen=True, eq=False)
class Turned:
    """Consistency of the views of each board: `turns` (camera, view) in quarters, `odd` views that disagree with the
    others, `boards`, T_rig_board (4, 4) by key, and the pairs of cameras `doubted`, whose views of a board disagree."""

    turns: dict[tuple[int, int], int]
    odd: list[tuple[int, int]]
    boards: dict[Key, Array]
    doubted: list[tuple[int, int]] = field(default_factory=list)


def turned(
    places: Mapping[int, Array], cameras: Sequence[Calibration], sights: Sights, edges: Sequence[Edge] = ()
) -> Turned:
    """Each board at the pose that most cameras agree on, with labels turned to those of the camera with which most
    others agree. `edges`: views that agree in a joint solution of two cameras' lenses do so here."""
    out = Turned({}, [], {})
    joint = {(*pair, key) for e in edges for key in e.joint for pair in ((e.a, e.b), (e.b, e.a))}
    keys = dict.fromkeys(k for c in places for k in sights[c])
    for key in keys:
        seers = [c for c in places if key in sights[c]]
        best: tuple[int, int, dict[int, tuple[float, int]]] | None = None
        for a in seers:
            views = {b: _compared(places, cameras, sights, key, a, b) for b in seers if b != a}
            views = {b: (0.0 if (a, b, key) in joint else gap, turn) for b, (gap, turn) in views.items()}
            votes = sum(gap <= 1 for gap, _ in views.values())
            if best is None or votes > best[0]:
                best = (votes, a, views)
        if best is None:
            continue
        votes, a, others = best
        out.boards[key] = np.linalg.inv(places[a]) @ matrix(cameras[a].views[sights[a][key]])
        for b, (gap, turn) in others.items():
            out.turns[b, sights[b][key]] = turn
            if gap > 1:
                out.odd.append((b, sights[b][key]))
                out.doubted.append((min(a, b), max(a, b)))
        if votes == 0 and others:  # two views that disagree: which of them is wrong is unknown
            out.odd.append((a, sights[a][key]))
    return out


def _compared(
    places: Mapping[int, Array], cameras: Sequence[Calibration], sights: Sights, key: Key, a: int, b: int
) -> tuple[float, int]:
    """Distance of camera b's view of a board from camera a's, 1 at the limit of agreement, and the turn of b's
    labels."""
    gap, turn = hypotheses(cameras[a], cameras[b], [(sights[a][key], sights[b][key])]).nearest(
        places[b] @ np.linalg.inv(places[a])
    )
    return float(gap[0]), int(turn[0])

"""Boards that are fixed to each other (on the sides of a plate, on a frame, in a room): their places, initially from
single views, and cameras that see different ones of them at the same moment.

What camera c saw of board b at moment m, T_c_b, is T_c_rig · T_rig_set(m) · T_set_b: places of cameras and of boards
enter alike. Groups of cameras whose places are known see sets of boards whose places are known; two groups that see one
set at the same moment are joined, and so are two sets that one group sees at the same moment, as votes over all such
moments. Where each group sees a set of its own only, both places follow from at least five moments in which the boards
were turned differently (AX = YB: Shah, Solving the robot-world/hand-eye calibration problem using the
Kronecker product, 2013).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, permutations

import numpy as np

from rcdn.calibration.hand_eye import hand_eye
from rcdn.calibration.relative_pose import Hypotheses, matrix
from rcdn.calibration.rig_start import Edge, Key, Sights, Turned, averaged, components_of, tree
from rcdn.types import Array, Calibration

Places = dict[int, Array]
"""poses (4, 4) by number: T_camera_group of cameras, T_set_board of boards"""


@dataclass(frozen=True, eq=False)
class FixedBoards:
    """`sets` of boards (one or more) whose relative poses are known: T_set_board (4, 4) by the number of the board's
    target; each set's frame is that of its first board, the one that most views show. `edges`: cameras that see
    different boards of a set at the same moment, as edges of the rig's graph."""

    sets: list[Places] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)

    def first_of(self, board: int) -> int:
        """The number of the first board of a board's set."""
        return next((next(iter(each)) for each in self.sets if board in each), board)

    def place_of(self, board: int) -> Array:
        """T_set_board (4, 4)."""
        return next((each[board] for each in self.sets if board in each), np.eye(4))

    def only(self, boards: Collection[int]) -> FixedBoards:
        """The same for these boards alone."""
        kept = [{b: T for b, T in each.items() if b in boards} for each in self.sets]
        back = [np.linalg.inv(next(iter(each.values()))) if each else np.eye(4) for each in kept]
        moved = [{b: B @ T for b, T in each.items()} for each, B in zip(kept, back, strict=True)]
        return FixedBoards([each for each in moved if each], self.edges)

    @property
    def others(self) -> list[int]:
        """The boards that are not the first of their set."""
        return [board for each in self.sets for board in list(each)[1:]]


@dataclass(frozen=True, eq=False)
class _Seen:
    """The poses of one set of boards in one group of cameras by moment: `T` (4, 4) and `reach`, the distance of the
    nearest camera, m."""

    T: dict[str, Array]
    reach: dict[str, float]


def placed_boards(cameras: Sequence[Calibration], sights: Sights, edges: Sequence[Edge]) -> FixedBoards:
    """The places of boards that are fixed to each other, as far as views tell them. `edges`: pairs of cameras that saw
    the same boards."""
    poses = _Poses(cameras, [_of_one_turn(c, each) for c, each in zip(cameras, sights, strict=True)])
    groups = [_group(part, edges) for part in components_of(len(cameras), edges)]
    seen_of = Counter(key[1] for each in poses.sights for key in each)
    sets: list[Places] = [{b: np.eye(4)} for b in sorted(seen_of, key=lambda b: (-seen_of[b], b))]
    found: list[Edge] = []
    while True:
        seen = [[poses.of(g, s) for s in sets] for g in groups]
        if _join_sets(sets, seen) or _join_groups(groups, sets, seen, found):
            continue
        if not _join_both(groups, sets, seen, found):
            return FixedBoards(sets, found)


def _of_one_turn(camera: Calibration, sights: Mapping[Key, int]) -> dict[Key, int]:
    """Those of the `sights` whose labels can't be turned: boards with codes, and plain ones whose colours tell."""
    plain = camera.target is None and camera.orientation == "unique"
    return {key: k for key, k in sights.items() if plain or camera.views[k].target is not None}


def _group(part: Sequence[int], edges: Sequence[Edge]) -> Places:
    inner = [e for e in edges if e.a in part and e.b in part]
    return averaged(tree(part, inner), inner)


@dataclass(frozen=True, eq=False)
class _Poses:
    """Poses of boards in the `cameras`, for the `sights` of each."""

    cameras: Sequence[Calibration]
    sights: Sequence[Mapping[Key, int]]

    def of(self, group: Places, boards: Places) -> _Seen:
        """The pose of a set of boards in a group of cameras at each moment: the one with which most of their views
        agree."""
        views: dict[str, list[tuple[Array, float]]] = {}
        for c, T_c in group.items():
            for (moment, b), k in self.sights[c].items():
                if b in boards:
                    T = matrix(self.cameras[c].views[k])
                    place = np.linalg.inv(T_c) @ T @ np.linalg.inv(boards[b])
                    views.setdefault(moment, []).append((place, float(np.linalg.norm(T[:3, 3]))))
        agreed = {moment: _vote(*zip(*each, strict=True))[0] for moment, each in views.items()}
        return _Seen(agreed, {moment: min(r for _, r in each) for moment, each in views.items()})


def _vote(poses: Sequence[Array], reach: Sequence[float]) -> tuple[Array, int]:
    """The pose with the most support among `poses`, and the number of those that support it."""
    return Hypotheses(np.array(poses)[:, None], (0,), np.array(reach)).most_agreed()


def _relative(pairs: list[tuple[Array, Array, float]]) -> tuple[Array, int] | None:
    """T_a_b from the poses (T_x_a, T_x_b) in one frame and their reach; None unless half of the pairs agree."""
    if not pairs:
        return None
    T, votes = _vote([np.linalg.inv(a) @ b for a, b, _ in pairs], [r for _, _, r in pairs])
    return (T, votes) if 2 * votes >= len(pairs) else None


def _best(
    count: int, relative_pose: Callable[[int, int], tuple[Array, int] | None]
) -> tuple[int, int, Array, int] | None:
    """The two of `count` things, and their relative pose, that most views tell."""
    found = [(a, b, *t) for a, b in combinations(range(count), 2) if (t := relative_pose(a, b)) is not None]
    return max(found, key=lambda f: f[3], default=None)


def _join_sets(sets: list[Places], seen: list[list[_Seen]]) -> bool:
    """Joins two sets that one group of cameras saw at the same moments."""

    def relative_pose(a: int, b: int) -> tuple[Array, int] | None:
        both = [(g[a], g[b], m) for g in seen for m in g[a].T if m in g[b].T]
        return _relative([(one.T[m], two.T[m], max(one.reach[m], two.reach[m])) for one, two, m in both])

    best = _best(len(sets), relative_pose)
    if best is None:
        return False
    a, b, T, _ = best
    sets[a] = sets[a] | {board: T @ P for board, P in sets.pop(b).items()}
    return True


def _join_groups(groups: list[Places], sets: list[Places], seen: list[list[_Seen]], found: list[Edge]) -> bool:
    """Joins two groups of cameras that saw the same set of boards at the same moments."""

    def common(a: int, b: int) -> list[tuple[int, str]]:
        return [(s, m) for s in range(len(sets)) for m in seen[a][s].T if m in seen[b][s].T]

    def relative_pose(a: int, b: int) -> tuple[Array, int] | None:
        views = [(seen[a][s], seen[b][s], m) for s, m in common(a, b)]
        return _relative([
            (np.linalg.inv(one.T[m]), np.linalg.inv(two.T[m]), max(one.reach[m], two.reach[m])) for one, two, m in views
        ])  # fmt: skip

    best = _best(len(groups), relative_pose)
    if best is None:
        return False
    a, b, T, votes = best
    keys = [(m, next(iter(sets[s]))) for s, m in common(a, b)]
    _merge(groups, found, a, b, T, keys, votes)
    return True


def _merge(groups: list[Places], found: list[Edge], a: int, b: int, T: Array, keys: list[Key], votes: int) -> None:
    """Joins group `b`, at T_a_b, to group `a`, and adds an edge between their first cameras."""
    one, two = groups[a], groups[b]
    moved = {c: P @ np.linalg.inv(T) for c, P in two.items()}
    c, d = sorted((next(iter(one)), next(iter(two))))
    joined = one | moved
    found.append(Edge(c, d, keys, joined[d] @ np.linalg.inv(joined[c]), votes))
    groups[a] = joined
    del groups[b]


def _join_both(groups: list[Places], sets: list[Places], seen: list[list[_Seen]], found: list[Edge]) -> bool:
    """Joins two groups of cameras, each of which saw a set of its own, and these sets."""
    pairs = []
    for a, b in combinations(range(len(groups)), 2):
        for s, t in permutations(range(len(sets)), 2):
            moments = [m for m in seen[a][s].T if m in seen[b][t].T]
            pairs.append((len(moments), a, b, s, t, moments))
    for _, a, b, s, t, moments in sorted(pairs, key=lambda p: -p[0]):
        one, two = seen[a][s], seen[b][t]
        solution = hand_eye(
            np.array([one.T[m] for m in moments]).reshape(-1, 4, 4),
            np.array([two.T[m] for m in moments]).reshape(-1, 4, 4),
            np.array([max(one.reach[m], two.reach[m]) for m in moments]),
        )
        if solution is None:
            continue
        T_b_a, T_s_t, votes = solution
        _merge(groups, found, a, b, np.linalg.inv(T_b_a), [(m, next(iter(sets[s]))) for m in moments], votes)
        low, high = sorted((s, t))
        T = T_s_t if low == s else np.linalg.inv(T_s_t)
        sets[low] = sets[low] | {board: T @ P for board, P in sets.pop(high).items()}
        return True
    return False


def in_sets(fits: Turned, fixed: FixedBoards, places: Mapping[int, Array], sights: Sights) -> Turned:
    """`fits` with one pose for each set and moment, of its first board; views of a board that disagrees with the others
    of its set are odd."""
    moments: dict[Key, list[Key]] = {}
    for key in fits.boards:
        moments.setdefault((key[0], fixed.first_of(key[1])), []).append(key)
    boards, odd = {}, list(fits.odd)
    for whole, keys in moments.items():
        poses = [fits.boards[key] @ np.linalg.inv(fixed.place_of(key[1])) for key in keys]
        reach = [_reach(fits.boards[key], key, places, sights) for key in keys]
        boards[whole], votes = _vote(poses, reach)
        gaps = Hypotheses(np.array(poses)[:, None], (0,), np.array(reach)).nearest(boards[whole])[0]
        wrong = [key for key, gap in zip(keys, gaps, strict=True) if gap > 1 or (votes == 1 and len(keys) > 1)]
        odd += [(c, sights[c][key]) for key in wrong for c in places if key in sights[c]]
    return Turned(fits.turns, list(dict.fromkeys(odd)), boards)


def _reach(T: Array, key: Key, places: Mapping[int, Array], sights: Sights) -> float:
    """Distance of a board, T_rig_board (4, 4), from the nearest camera that saw it, m."""
    return min(float(np.linalg.norm((P @ T)[:3, 3])) for c, P in places.items() if key in sights[c])

"""Pose of a second camera relative to the first, from the poses of boards that both saw: the hypothesis with the most
support among the pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rcdn.errors import CalibrationError, many, present
from rcdn.geometry.order import turn_labels
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Real

FEWEST_PAIRS = 3
AGREE = (np.radians(5.0), 0.1)
"""largest differences, rad and share of the boards' distance, at which two pairs agree on the relative pose"""
MOST_SHIFT = 3
"""largest shift in the order of one camera's images that is tried"""


def place(
    first: Calibration,
    second: Calibration,
    pairs: list[tuple[int, int]],
    given: Sequence[tuple[int, int]] | None = None,
) -> tuple[Array, dict[int, int], list[tuple[int, int]]]:
    """T_right_left (4, 4) with the most support among the pairs, the turns of right boards that it needs, and the pairs
    that disagree.

    `given`: all pairs in the order of the images, including those without information (default: `pairs`): where most
    disagree, the error says whether they would agree if the right images were shifted against the left ones. Raises
    CalibrationError if no hypothesis has the support of half of the pairs.
    """
    poses = hypotheses(first, second, pairs)
    best, most = poses.most_agreed()
    if 2 * most < len(pairs) or most < FEWEST_PAIRS:
        raise CalibrationError(_disagree(first, second, pairs, most, pairs if given is None else given))
    gaps, turns = poses.nearest(best)
    turned = {b: int(q) for (_, b), gap, q in zip(pairs, gaps, turns, strict=True) if gap <= 1}
    return best, turned, [pair for pair, gap in zip(pairs, gaps, strict=True) if gap > 1]


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """What pairs of views say of a relative pose: `T` (P, Q, 4, 4) for each pair and turn of the board, the quarters of
    each `turn` (Q,), and the boards' distances `reach` (P,), m."""

    T: Array
    turn: tuple[int, ...]
    reach: Array

    def __len__(self) -> int:
        return len(self.T)

    def gaps(self, T: Real[Array, "4 4"]) -> Real[Array, "p q"]:
        """(P, Q) distances from the pose T, 1 at the limit of agreement."""
        cosine = (np.einsum("pqij,ij->pq", self.T[:, :, :3, :3], T[:3, :3]) - 1) / 2
        turn = np.arccos(np.clip(cosine, -1, 1)) / AGREE[0]
        shift = np.linalg.norm(self.T[:, :, :3, 3] - T[:3, 3], axis=2) / (AGREE[1] * self.reach[:, None])
        return np.maximum(turn, shift)

    def nearest(self, T: Real[Array, "4 4"]) -> tuple[Array, Array]:
        """(P,) the smallest of each pair's distances from the pose T, and the turn that attains it."""
        gaps = self.gaps(T)
        best = np.argmin(gaps, axis=1)
        return gaps[np.arange(len(gaps)), best], np.array(self.turn)[best]

    def most_agreed(self) -> tuple[Array, int]:
        """The pose, among those of all pairs, with the most support, and the number of pairs that support it."""
        best, most = self.T[0, 0], -1
        for T in self.T.reshape(-1, 4, 4):
            votes = int((self.gaps(T).min(axis=1) <= 1).sum())
            if votes > most:
                best, most = T, votes
        return best, most


def hypotheses(first: Calibration, second: Calibration, pairs: Sequence[tuple[int, int]]) -> Hypotheses:
    """T_right_left by each of the pairs (index of the left view, index of the right view)."""
    left = np.array([matrix(first.views[a]) for a, _ in pairs])
    right, turns = np.array([matrix(second.views[b]) for _, b in pairs]), _turns(first)
    undo = np.array([_undo(q, second) for q in turns])
    T = right[:, None] @ undo[None] @ np.linalg.inv(left)[:, None]
    return Hypotheses(T, turns, np.linalg.norm(left[:, :3, 3], axis=1))


def _disagree(
    first: Calibration,
    second: Calibration,
    pairs: list[tuple[int, int]],
    most: int,
    given: Sequence[tuple[int, int]],
) -> str:
    text = f"only {most} of {many(len(pairs), 'pair')} {'agrees' if most == 1 else 'agree'} on where the cameras stand"
    if (
        first.orientation == "unique"
        and first.target is None
        and _agree_mirrored(first, second, pairs) > max(most, len(pairs) // 2)
    ):
        return f"{text}, but they would if one camera's pictures were mirrored: turn its mirror (selfie) mode off"
    if (found := _shift(first, second, given, most)) is not None:
        by, agreeing, (a, b) = found
        first_ones = "picture" if abs(by) == 1 else f"{abs(by)} pictures"
        return (
            f"{text}, but {agreeing} would if the right pictures were shifted by {abs(by)}: {first.views[a].name} then "
            f"belongs to {second.views[b].name}, and so on. Name the pairs (--pairs; in Python pairs), or, "
            f"where order pairs them and not names, leave out the first {first_ones} of the "
            f"{'right' if by > 0 else 'left'} camera"
        )
    return (
        f"{text}: are the pictures paired by the same moment, and did the cameras hold still on their mount? If names "
        "and order don't tell, name the pairs (--pairs; in Python pairs)"
    )


def _shift(
    first: Calibration, second: Calibration, given: Sequence[tuple[int, int]], most: int
) -> tuple[int, int, tuple[int, int]] | None:
    """The shift of the right images, the number of pairs that agree with it, and the first of those pairs; None if no
    shift explains it."""
    best = None
    for by in sorted((k for k in range(-MOST_SHIFT, MOST_SHIFT + 1) if k), key=abs):
        late, early = given[max(0, -by) :], given[max(0, by) :]
        pairs = [
            (a, b)
            for (a, _), (_, b) in zip(late, early, strict=False)
            if determines_pose(first.views[a], second.views[b])
        ]
        if len(pairs) < FEWEST_PAIRS:
            continue
        votes = hypotheses(first, second, pairs).most_agreed()[1]
        if votes >= max(2 * len(pairs) / 3, FEWEST_PAIRS, most + 1) and (best is None or votes > best[1]):
            best = (by, votes, pairs[0])
    return best


def determines_pose(*views: BoardView) -> bool:
    """Whether views of one board determine the relative pose of cameras: their labels are settled, and they were not
    left out."""
    return all(v.settled and not v.reason and v.target == views[0].target for v in views)


def _agree_mirrored(first: Calibration, second: Calibration, pairs: list[tuple[int, int]]) -> int:
    """Number of pairs that would agree if the right images were mirrored."""
    flip, undo = np.diag([-1.0, 1, 1, 1]), np.eye(4)
    size = present(first.size, "Calibration.size")
    axis = reversed_in_a_mirror(size)
    undo[axis, axis], undo[axis, 3] = -1, (size[axis] - 1) * second.spacing
    found = []
    for a, b in pairs:
        T = flip @ matrix(second.views[b]) @ undo  # reverses the camera's x axis, and that axis of the board
        T[:3, 2] = np.cross(T[:3, 0], T[:3, 1])
        found.append(T @ np.linalg.inv(matrix(first.views[a])))
    reach = np.array([np.linalg.norm(matrix(first.views[a])[:3, 3]) for a, _ in pairs])
    return Hypotheses(np.array(found)[:, None], (0,), reach).most_agreed()[1]


def reversed_in_a_mirror(size: tuple[int, int]) -> int:
    """The axis of a board of this `size` (columns, rows), one of them even, along which labels run the other way in a
    mirrored picture: 0 for columns, 1 for rows. A mirror exchanges the colours around each corner, as does reversing an
    even number of corners; labels stay right-handed."""
    return 0 if size[0] % 2 == 0 else 1


def matrix(view: BoardView) -> Array:
    return present(view.pose, "the pose of a view").T_cam_board


def _turns(calibration: Calibration) -> tuple[int, ...]:
    """Numbers of quarter turns that preserve a complete board's colours."""
    return {"unique": (0,), "ambiguous_180": (0, 2), "ambiguous_90": (0, 1, 2, 3)}[calibration.orientation or "unique"]


def _undo(turn: int, calibration: Calibration) -> Real[Array, "4 4"]:
    """(4, 4) takes coordinates of a board whose labels were turned by `turn` quarters to those of its own labels."""
    undo = np.eye(4)
    if not turn:
        return undo
    size = present(calibration.size, "Calibration.size")
    corners = np.array([[0.0, 0], [1, 0], [0, 1]])
    back = turn_labels(corners, size if turn % 2 == 0 else size[::-1], -turn % 4)
    undo[:2, 0], undo[:2, 1], undo[:2, 3] = back[1] - back[0], back[2] - back[0], back[0] * calibration.spacing
    return undo

"""Pose of a second camera relative to the first, from the poses of boards that both saw: the hypothesis with the most
support among the pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration.labels import turn_labels
from rcdn.errors import CalibrationError, many, present
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
    best, most = most_agreed(first, second, pairs)
    if 2 * most < len(pairs) or most < FEWEST_PAIRS:
        raise CalibrationError(_disagree(first, second, pairs, most, pairs if given is None else given))
    turned, odd = {}, []
    for pair in pairs:
        gap, turn = nearest(best, hypothesis(first, second, pair))
        if gap <= 1:
            turned[pair[1]] = turn
        else:
            odd.append(pair)
    return best, turned, odd


@dataclass(frozen=True, eq=False)
class _Hypothesis:
    """The hypotheses of one pair on the relative pose: `places` (turn of the right board, T_right_left), and the
    board's distance `reach`, m."""

    places: list[tuple[int, Array]]
    reach: float


def hypothesis(first: Calibration, second: Calibration, pair: tuple[int, int]) -> _Hypothesis:
    left, right = first.views[pair[0]], second.views[pair[1]]
    back = np.linalg.inv(matrix(left))
    places = [(q, _pose(right, q, second) @ back) for q in _turns(first)]
    return _Hypothesis(places, float(np.linalg.norm(matrix(left)[:3, 3])))


def nearest(T: Array, told: _Hypothesis) -> tuple[float, int]:
    """The smallest distance of a pair's hypotheses from T, 1 at the limit of agreement, and the turn of the one that
    attains it."""
    return min((_gap(T, U, told.reach), q) for q, U in told.places)


def most_agreed(first: Calibration, second: Calibration, pairs: Sequence[tuple[int, int]]) -> tuple[Array, int]:
    """The hypothesis, among those of all pairs, with the most support, and the number of pairs that support it."""
    told = [hypothesis(first, second, pair) for pair in pairs]
    best, most = told[0].places[0][1], -1
    for each in told:
        for _, T in each.places:
            votes = sum(nearest(T, other)[0] <= 1 for other in told)
            if votes > most:
                best, most = T, votes
    return best, most


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
            f"{text}, but {agreeing} would if the right pictures were shifted by {abs(by)}: {first.views[a].name} then belongs to "
            f"{second.views[b].name}, and so on. Leave out the first {first_ones} of the {'right' if by > 0 else 'left'} camera, or name "
            "the pairs (--pairs)"
        )
    return (
        f"{text}: are the pictures paired by the same moment, and did the cameras hold still on their mount? If names and "
        "order don't tell, name the pairs (--pairs)"
    )


def _shift(
    first: Calibration, second: Calibration, given: Sequence[tuple[int, int]], most: int
) -> tuple[int, int, tuple[int, int]] | None:
    """The shift of the right images, the number of pairs that agree with it, and the first of those pairs; None if no
    shift explains it."""
    best = None
    for by in sorted((k for k in range(-MOST_SHIFT, MOST_SHIFT + 1) if k), key=abs):
        late, early = given[max(0, -by) :], given[max(0, by) :]
        pairs = [(a, b) for (a, _), (_, b) in zip(late, early, strict=False) if tells(first.views[a], second.views[b])]
        if len(pairs) < FEWEST_PAIRS:
            continue
        votes = most_agreed(first, second, pairs)[1]
        if votes >= max(2 * len(pairs) / 3, FEWEST_PAIRS, most + 1) and (best is None or votes > best[1]):
            best = (by, votes, pairs[0])
    return best


def tells(*views: BoardView) -> bool:
    """Whether views of one board determine the relative pose of cameras: their labels are settled, and they were not
    left out."""
    return all(v.settled and not v.reason and v.target == views[0].target for v in views)


def _agree_mirrored(first: Calibration, second: Calibration, pairs: list[tuple[int, int]]) -> int:
    """Number of pairs that would agree if the right images were mirrored."""
    flip = np.diag([-1.0, 1, 1, 1])
    cols = (first.size or (1, 1))[0] - 1
    undo = np.diag([-1.0, 1, 1, 1])
    undo[0, 3] = cols * second.spacing
    found = []
    for a, b in pairs:
        T = flip @ matrix(second.views[b]) @ undo  # reverses the x axes of camera and board
        T[:3, 2] = np.cross(T[:3, 0], T[:3, 1])
        found.append(T @ np.linalg.inv(matrix(first.views[a])))
    reach = [float(np.linalg.norm(matrix(first.views[a])[:3, 3])) for a, _ in pairs]
    return max(sum(_gap(T, U, r) <= 1 for U, r in zip(found, reach, strict=True)) for T in found)


def matrix(view: BoardView) -> Array:
    return present(view.pose, "the pose of a view").T_cam_board


def _turns(calibration: Calibration) -> tuple[int, ...]:
    """Numbers of quarter turns that preserve a complete board's colours."""
    return {"unique": (0,), "ambiguous_180": (0, 2), "ambiguous_90": (0, 1, 2, 3)}[calibration.orientation or "unique"]


def _pose(view: BoardView, turn: int, calibration: Calibration) -> Real[Array, "4 4"]:
    """The pose (4, 4) of the view's board if its labels are turned by `turn` quarters."""
    size = present(calibration.size, "Calibration.size")
    corners = np.array([[0.0, 0], [1, 0], [0, 1]])
    back = turn_labels(corners, size if turn % 2 == 0 else size[::-1], -turn % 4)
    undo = np.eye(4)  # from coordinates of the turned labels to those of the view
    undo[:2, 0], undo[:2, 1], undo[:2, 3] = back[1] - back[0], back[2] - back[0], back[0] * calibration.spacing
    return np.asarray(matrix(view) @ undo)


def _gap(T: Array, U: Array, reach: float) -> float:
    """Distance of two relative poses, in units of the limit of agreement."""
    turn = Rotation.from_matrix(T[:3, :3] @ U[:3, :3].T).magnitude()
    return float(max(turn / AGREE[0], np.linalg.norm(T[:3, 3] - U[:3, 3]) / (AGREE[1] * reach)))

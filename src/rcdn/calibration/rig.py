"""Where a second camera stands, from the poses of boards that both saw: the place that most pairs agree on."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rcdn.calibration.labels import turn_labels
from rcdn.errors import CalibrationError
from rcdn.types import Array, BoardView, Calibration

FEWEST_PAIRS = 3
AGREE = (np.radians(5.0), 0.1)
"""rad, and share of the boards' distance, within which two pairs tell the same place of the cameras"""


def place(
    first: Calibration, second: Calibration, pairs: list[tuple[int, int]]
) -> tuple[Array, dict[int, int], list[tuple[int, int]]]:
    """T_right_left (4, 4) that most pairs agree on, the half or quarter turns of right boards that it needs, and the pairs that disagree."""
    found = [
        [(q, _pose(second.views[b], q, second) @ np.linalg.inv(matrix(first.views[a]))) for q in _turns(first)]
        for a, b in pairs
    ]
    reach = [float(np.linalg.norm(matrix(first.views[a])[:3, 3])) for a, _ in pairs]
    best, most = found[0][0][1], -1
    for candidates in found:
        for _, T in candidates:
            votes = sum(min(_gap(T, U, r) for _, U in c) <= 1 for c, r in zip(found, reach, strict=True))
            if votes > most:
                best, most = T, votes
    if 2 * most < len(pairs) or most < FEWEST_PAIRS:
        raise CalibrationError(_disagree(first, second, pairs, most))
    turned, odd = {}, []
    for pair, candidates, r in zip(pairs, found, reach, strict=True):
        gap, turn = min((_gap(best, U, r), q) for q, U in candidates)
        if gap <= 1:
            turned[pair[1]] = turn
        else:
            odd.append(pair)
    return best, turned, odd


def _disagree(first: Calibration, second: Calibration, pairs: list[tuple[int, int]], most: int) -> str:
    text = f"only {most} of {len(pairs)} pairs agree on where the cameras stand"
    if first.orientation == "unique" and _agree_mirrored(first, second, pairs) > max(most, len(pairs) // 2):
        return f"{text}, but they would if one camera's pictures were mirrored: turn its mirror (selfie) mode off"
    return f"{text}: are the pictures paired by the same moment, and did the cameras hold still on their mount?"


def _agree_mirrored(first: Calibration, second: Calibration, pairs: list[tuple[int, int]]) -> int:
    """How many pairs would agree if the right pictures were mirrored."""
    flip = np.diag([-1.0, 1, 1, 1])
    cols = (first.size or (1, 1))[0] - 1
    undo = np.diag([-1.0, 1, 1, 1])
    undo[0, 3] = cols * second.spacing
    found = []
    for a, b in pairs:
        T = flip @ matrix(second.views[b]) @ undo  # x of camera and of board run the other way
        T[:3, 2] = np.cross(T[:3, 0], T[:3, 1])
        found.append(T @ np.linalg.inv(matrix(first.views[a])))
    reach = [float(np.linalg.norm(matrix(first.views[a])[:3, 3])) for a, _ in pairs]
    return max(sum(_gap(T, U, r) <= 1 for U, r in zip(found, reach, strict=True)) for T in found)


def matrix(view: BoardView) -> Array:
    assert view.pose is not None
    return view.pose.T_cam_board


def _turns(calibration: Calibration) -> tuple[int, ...]:
    """Quarter turns that leave a whole board's colours as they are."""
    return {"unique": (0,), "ambiguous_180": (0, 2), "ambiguous_90": (0, 1, 2, 3)}[calibration.orientation or "unique"]


def _pose(view: BoardView, turn: int, calibration: Calibration) -> Array:
    """The pose (4, 4) of the view's board if its labels are turned by `turn` quarters."""
    assert calibration.size is not None
    corners = np.array([[0.0, 0], [1, 0], [0, 1]])
    back = turn_labels(corners, calibration.size if turn % 2 == 0 else calibration.size[::-1], -turn % 4)
    undo = np.eye(4)  # takes turned labels' coordinates to those of the view
    undo[:2, 0], undo[:2, 1], undo[:2, 3] = back[1] - back[0], back[2] - back[0], back[0] * calibration.spacing
    return np.asarray(matrix(view) @ undo)


def _gap(T: Array, U: Array, reach: float) -> float:
    """How far two places are apart, in units of what counts as agreeing."""
    turn = Rotation.from_matrix(T[:3, :3] @ U[:3, :3].T).magnitude()
    return float(max(turn / AGREE[0], np.linalg.norm(T[:3, 3] - U[:3, 3]) / (AGREE[1] * reach)))

"""Selection of the boards that a calibration can use, as arrays, and the reasons for rejecting the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rcdn.calibration.bundle import Corners3
from rcdn.calibration.coded import Geometry
from rcdn.calibration.groups import describe
from rcdn.calibration.labels import Labelled, mirrored
from rcdn.calibration.shape import FUNCTIONS, shape_basis
from rcdn.calibration.start import Seen
from rcdn.errors import CalibrationError, many
from rcdn.geometry.cut import in_line
from rcdn.types import Array, Board, BoardView, Pose
from rcdn.types.arrays import Real

FEWEST_CORNERS, FEWEST_VIEWS = 6, 3
LOOSEST = 1e3
"""px; a larger sigma is reduced to this"""
SAME_SIZE = 0.75
"""least share of boards whose pictures have the most frequent size: the others are then left out; a smaller share is an
error"""


@dataclass(frozen=True, eq=False)
class Usable:
    """The boards that can be used: `index` of each among all, their corners `seen`, `reasons` by index for those
    rejected; `corners`, `sigma` (N,), `picture` (N,) number; `settled`: number of views in which it is known which
    corner of the board is which."""

    index: list[int]
    seen: list[Seen]
    reasons: dict[int, str]
    corners: Corners3
    sigma: Array
    picture: Array
    settled: int


def one_size(boards: Sequence[Board], names: Sequence[str]) -> tuple[int, int]:
    """The image size of (nearly) all pictures. Raises CalibrationError, naming the pictures of each size, if no size is
    frequent enough."""
    sizes = Counter(dict(zip(names, (b.image_size for b in boards), strict=True)).values())
    (majority, count), *_ = sizes.most_common(1)
    if count >= SAME_SIZE * sizes.total():
        return majority
    upright = majority[0] != majority[1] and majority[::-1] in sizes
    turned = ". Width and height are exchanged in some: turn those pictures back by 90°" if upright else ""
    raise CalibrationError(
        f"pictures of several sizes ({_by_size(boards, names, sizes)}): one calibration is of one camera at one "
        "resolution; calibrate the pictures of each size by themselves. Crops and resized copies belong to no camera: "
        f"take pictures as they were stored{turned}"
    )


def _by_size(boards: Sequence[Board], names: Sequence[str], sizes: Counter[tuple[int, int]]) -> str:
    """Each size with the pictures that have it."""
    texts = []
    for size, count in sizes.most_common():
        mine = [n for n, b in zip(names, boards, strict=True) if b.image_size == size]
        rest = [n for n, b in zip(names, boards, strict=True) if b.image_size != size]
        texts.append(f"{size[0]}×{size[1]} in {count}: {describe(mine, rest)}")
    return "; ".join(texts)


def _unusable(board: Board, label: Labelled, image_size: tuple[int, int]) -> str:
    """The reason why a board cannot be used, or ""."""
    if board.image_size != image_size:
        (w, h), (cols, rows) = board.image_size, image_size
        return f"its picture has {w}×{h} px, the others {cols}×{rows}"
    if label.reason:
        return label.reason
    if len(board) < FEWEST_CORNERS or min(board.size) < 2:
        return f"it has only {many(len(board), 'corner')} in {board.size[0]}×{board.size[1]}"
    if in_line(board.ij, board.xy):
        return "its corners lie in one line"
    return (
        "its labels run the wrong way round, as if pixels were mirrored after the corners were found"
        if board.target is None and mirrored(board)  # a board with codes may be seen from behind
        else ""
    )


def usable(
    boards: Sequence[Board],
    labels: list[Labelled],
    names: Sequence[str],
    image_size: tuple[int, int],
    whole: Geometry,
    fewest: int = FEWEST_VIEWS,
) -> Usable:
    """The boards with enough corners, at least `fewest` of them, as arrays;
    `whole`: the board whose shape may be estimated."""
    numbers = {name: k for k, name in enumerate(dict.fromkeys(names))}
    index, reasons = [], {}
    for k, (board, label) in enumerate(zip(boards, labels, strict=True)):
        if reason := _unusable(board, label, image_size):
            reasons[k] = reason
        else:
            index.append(k)
    if len(index) < fewest:
        raise CalibrationError(too_few(len(index), reasons))
    seen = [Seen(labels[k].places, boards[k].xy) for k in index]
    lengths = [len(s.xy) for s in seen]
    frame = np.repeat(np.arange(len(index)), lengths)
    sigma = np.concatenate([sigma_of(boards[k]) for k in index])
    corners = Corners3(
        frame,
        np.zeros(len(frame), int),
        np.concatenate([s.board for s in seen]),
        np.concatenate([s.xy for s in seen]),
        _basis([labels[k] for k in index], whole),
    )
    picture = np.repeat([numbers[names[k]] for k in index], lengths)
    settled = sum(labels[k].settled and labels[k].main for k in index)
    return Usable(index, seen, reasons, corners, np.nan_to_num(sigma), picture, settled)


def _basis(labels: list[Labelled], whole: Geometry) -> Real[Array, "n b"]:
    """(N, B) functions of the board's shape at the corners; 0 in views of other boards, or in which it is unknown which
    corner is which."""
    rows = np.repeat([label.settled and label.main for label in labels], [len(label.ij) for label in labels])
    out = np.zeros((len(rows), len(FUNCTIONS)))
    if whole.size and rows.any():
        out[rows] = shape_basis(np.concatenate([label.ij for label in labels])[rows], whole.size, whole.plane)
    return out


def too_few(views: int, reasons: dict[int, str]) -> str:
    """The message that there are only so many `views`, with the first of the `reasons` by index why others can't be
    used."""
    got = "one view" if views == 1 else f"{views} views" if views else "no view that can be used"
    verb = "are" if views > 1 else "is"
    return (
        f"there {verb} {got}{_why_not_more(views, list(reasons.values()))}. A camera takes {FEWEST_VIEWS} at least, "
        "and to be trusted 10 to 30 pictures of the board in different places and tilts"
    )


def _why_not_more(views: int, reasons: Sequence[str]) -> str:
    if not reasons:
        return ""
    one = len(reasons) == 1
    if not views:
        return f"; {'the only one' if one else f'the first of {len(reasons)}'} can't, since {reasons[0]}"
    return f"; {len(reasons)} more can't be used, {'since' if one else 'the first since'} {reasons[0]}"


def sigma_of(board: Board) -> Real[Array, " m"]:
    """(M,) px; NaN where unknown."""
    return np.full(len(board), np.nan) if board.sigma is None else np.clip(board.sigma, 0, LOOSEST)


def board_view(
    board: Board,
    label: Labelled,
    name: str,
    number: int = 0,
    pose: Pose | None = None,
    residuals: Array | None = None,
    used: Array | None = None,
    reason: str = "",
) -> BoardView:
    """A `board` with its `label`, number `number` of the picture `name`, as a calibration used it; `residuals` (M, 2)
    px, None for NaN; `used` (M,) bool, None for no corner; `reason` why it was left out."""
    return BoardView(
        name=name,
        board=number,
        ij=label.ij,
        xy=board.xy,
        sigma=sigma_of(board),
        pose=pose,
        residuals=np.full((len(board), 2), np.nan) if residuals is None else residuals,
        used=np.zeros(len(board), bool) if used is None else used,
        reason=reason,
        settled=label.settled,
        target=label.target,
        ids=None if label.target is None else board.ids,
        plane=label.plane,
        spacing=label.spacing,
    )


def with_poses(task: Usable, T: Array, fewest: int = FEWEST_VIEWS) -> tuple[Usable, Array]:
    """The task without the views whose pose is NaN, and the remaining poses: at least `fewest`."""
    good = np.asarray(np.isfinite(T).all(axis=(1, 2)))
    if good.all():
        return task, T
    reasons = task.reasons | {k: "no pose fits its corners" for k, g in zip(task.index, good, strict=True) if not g}
    if good.sum() < fewest:
        raise CalibrationError(too_few(int(good.sum()), reasons))
    keep = good[task.corners.frame]
    number = np.cumsum(good) - 1
    corners = task.corners.take(keep)
    corners = replace(corners, frame=number[corners.frame])
    index = [k for k, g in zip(task.index, good, strict=True) if g]
    seen = [s for s, g in zip(task.seen, good, strict=True) if g]
    return Usable(index, seen, reasons, corners, task.sigma[keep], task.picture[keep], task.settled), T[good]

"""Selection of video frames for calibration: sharp ones, each different from the others.

There are two steps. `candidates` needs no detection: it uses a `FrameSummary` of every frame, and limits how many
frames are passed to the detector. `choose_views` then keeps, among the candidates with a board, those whose boards
differ most in place, size and tilt. Both depend on their arguments only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from rcdn.calibration.outlines import distances, outline
from rcdn.io import ImageResult
from rcdn.io.images import RATE
from rcdn.types import Array, Board
from rcdn.types.arrays import Real

CANDIDATES, VIEWS = 150, 40
"""most candidates of a video, and most frames that are kept"""
WIDE = 640
"""px: width to which frames are reduced; smaller ones are used as they are"""
THUMB, SMOOTH = (16, 12), 1.5
"""(width, height) of the thumbnails that are compared, and the sigma of their smoothing, so that they change gradually
as a board moves"""
NEAR, SHARP = 0.23, 0.7
"""a frame is sharp if its energy is at least SHARP × the largest within NEAR seconds of it, in which a board moves
little; frames further apart may show it nearer or farther"""
SAME = 0.02
"""share of a thumbnail's mean: frames that differ by less show the same"""
ALIKE = 0.004
"""share of the diagonal: boards whose outlines differ by less are redundant"""
BLURRED = 4.0
"""× the median sigma of the views: a frame with a larger one is left out"""


@dataclass(frozen=True, eq=False)
class FrameSummary:
    """Summary of a frame.

    `energy` of its gradients, grey levels²; `small` (12, 16) float32: total variation of its grey values in each cell,
    grey levels per pixel.
    """

    energy: float
    small: Array


def frame_summary(grey: Array) -> FrameSummary:
    """Summary of a frame (H, W).

    The energy is the geometric mean of those along x and y: motion blur reduces only the one along its direction. The
    thumbnail contains total variation, which blur does not change, and which shows where a board is regardless of the
    colours of its squares there.
    """
    height, width = grey.shape
    scale = min(1.0, WIDE / width)
    size = max(2, round(width * scale)), max(2, round(height * scale))
    view = cv2.resize(grey, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    dx, dy = np.diff(view, axis=1)[:-1], np.diff(view, axis=0)[:, :-1]
    small = cv2.resize(np.abs(dx) + np.abs(dy), THUMB, interpolation=cv2.INTER_AREA)
    energy = float(np.sqrt(np.square(dx).mean() * np.square(dy).mean()))
    return FrameSummary(energy, cv2.GaussianBlur(small, (0, 0), SMOOTH))


def candidates(summaries: Sequence[FrameSummary], most: int = CANDIDATES, rate: float = RATE) -> list[int]:
    """Indices, ascending, of at most `most` frames that are sharp among their neighbours in time and differ from each
    other. `rate`: frames a second.

    The sharpest frame of each of `most` ÷ 2 equal intervals of time is selected first, so that no part of the video is
    missed; then those that differ most from all selected ones.
    """
    if not summaries:
        return []
    energy = np.array([g.energy for g in summaries])
    small = np.stack([g.small.ravel() for g in summaries])
    small /= max(float(np.percentile(small.mean(axis=1), 90)), 1e-6)
    eligible = energy >= SHARP * _largest_near(energy, round(NEAR * rate))
    gap = np.where(eligible, np.inf, -1.0)
    chosen: list[int] = []

    def take(k: int) -> None:
        chosen.append(k)
        np.minimum(gap, np.abs(small - small[k]).mean(axis=1), out=gap)

    for stretch in np.array_split(np.arange(len(summaries)), max(1, min(most // 2, len(summaries)))):
        best = int(stretch[np.argmax(np.where(eligible[stretch], energy[stretch], -1.0))])
        if gap[best] > SAME and len(chosen) < most:
            take(best)
    while len(chosen) < most and gap.max() > SAME:
        take(int(np.argmax(gap)))
    return sorted(chosen)


def _largest_near(energy: Array, near: int) -> Real[Array, " n"]:
    """(N,) the largest energy within `near` frames."""
    padded = np.pad(energy, near, constant_values=-np.inf)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * near + 1).max(axis=1))


def choose_views(images: Sequence[ImageResult], most: int = VIEWS) -> list[int]:
    """Indices, ascending, of at most `most` images whose (largest) boards are precise and complete and differ most.

    Images without a board, boards much less precise than usual, and boards in the same place as another are left out.
    Farthest-point selection, starting from the best board: each next one has the largest product of its distance from
    the selected ones and its weight.
    """
    index = [k for k, image in enumerate(images) if image.boards]
    boards = [images[k].boards[0] for k in index]
    if not boards:
        return []
    outlines = np.stack([outline(board) for board in boards])
    worth = _worth(boards)
    gap = np.where(worth > 0, np.inf, -1.0)
    chosen = [int(np.argmax(worth))]
    while len(chosen) < most:
        gap = np.minimum(gap, distances(outlines, outlines[chosen[-1]]))
        if gap.max() <= ALIKE:
            break
        chosen.append(int(np.argmax(gap * worth)))
    return sorted(index[k] for k in chosen)


def _worth(boards: Sequence[Board]) -> Real[Array, " n"]:
    """(N,) weight in [0, 1]: smaller for imprecise corners and for few of them; 0 for blurred boards."""
    sigma = np.array([_median_sigma(board) for board in boards])
    known = sigma[np.isfinite(sigma)]
    typical = float(np.median(known)) if len(known) else 1.0
    ratio = np.where(np.isfinite(sigma), sigma, typical) / max(typical, 1e-9)
    count = np.array([len(board) for board in boards], float)
    precise = np.where(ratio > BLURRED, 0.0, np.minimum(1.0, 1 / np.maximum(ratio, 1e-9)))
    return np.asarray(precise * np.sqrt(count / count.max()))


def _median_sigma(board: Board) -> float:
    """Median of the corners' sigma, px; NaN if all are unknown."""
    if board.sigma is None or not np.isfinite(board.sigma).any():
        return float("nan")
    return float(np.nanmedian(board.sigma))

"""Cameras from coded boards, ours and OpenCV's, evaluated on pictures from which they were not calibrated.

For each of several random halves of a set of pictures both calibrate from one half, each from its own corners with its
own solver: ours is given only the spacing, OpenCV the target, too (CharucoDetector, then `calibrateCamera` with k1 k2
p1 p2 k3). In each picture of the other half the pose is solved by least squares from every second corner, and the
residuals of the others count; then the two are exchanged:

    RMS = √(Σ |observed − projected|² / N)

over all corners of all pictures and halves that both found. Each uses its own corners and its own camera, and ours the
board's shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rcdn.calibration import calibrate
from rcdn.calibration.bundle import Corners3, State, default_free, residuals
from rcdn.calibration.coded import identity
from rcdn.calibration.shape import KNOWN, on_shape
from rcdn.calibration.solver import solve
from rcdn.calibration.start import Seen, poses
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import CalibrationError, RcdnError, present
from rcdn.io import read_image
from rcdn.io.files import PICTURE_ENDINGS
from rcdn.types import Array, Board, BoardShape, Camera, Charuco
from rcdn_lab.peers.coded.opencv import OPENCV

FEWEST_SHARED, FEWEST_PICTURES = 12, 8


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture: our `board`, and OpenCV's corners with `ids` (M,) at `xy` (M, 2)."""

    name: str
    board: Board
    ids: Array
    xy: Array

    @property
    def common(self) -> Array:
        """The ids of the corners that both found."""
        return np.intersect1d(present(self.board.ids, "ids"), self.ids)


@dataclass(frozen=True, eq=False)
class Known:
    """A camera, and the shape of the board estimated with it."""

    camera: Camera
    shape: BoardShape | None = None


def pictures_of(folder: Path) -> list[Path]:
    """The pictures of a folder, by name. Raises RcdnError if there are none."""
    if not folder.is_dir() or not (found := sorted(p for p in folder.iterdir() if p.suffix.lower() in PICTURE_ENDINGS)):
        raise RcdnError(f"{folder} is no folder of pictures")
    return found


def shots_of(paths: Sequence[Path], step: Callable[[int, int], None] | None = None) -> list[Shot]:
    """The pictures in which both found the most frequent ChArUco board; ours is given no target, OpenCV the one that
    ours read."""
    detector = Detector(DetectorConfig.preset("auto", target="auto"))
    found: list[tuple[str, Array, Board]] = []
    for k, path in enumerate(paths):
        grey = read_image(path)
        found += [(path.name, grey, b) for b in detector.boards(grey)[:1] if isinstance(b.target, Charuco)]
        if step is not None:
            step(k + 1, len(paths))
    if not found:
        raise RcdnError("no ChArUco board was read in these pictures")
    kinds = [identity(b.target) for _, _, b in found if b.target is not None]
    majority = max(set(kinds), key=kinds.count)
    whole = max(
        (b.target for _, _, b in found if b.target is not None and identity(b.target) == majority),
        key=lambda t: getattr(t, "rows", 0) or 0,
    )
    read, shots = OPENCV.load(), []
    for (name, grey, board), kind in zip(found, kinds, strict=True):
        theirs = read(grey, whole) if kind == majority else []
        if theirs:
            shot = Shot(name, board, theirs[0].ids, theirs[0].xy)
            shots += [shot] if len(shot.common) >= FEWEST_SHARED else []
    return shots


def compared(shots: Sequence[Shot], spacing: float, seeds: int) -> dict[str, Any]:
    """The held-out RMS of both, px, over `seeds` random halves; halves that determine no camera for one of them are
    counted in `failed`.

    Raises RcdnError with fewer than 8 pictures.
    """
    if len(shots) < FEWEST_PICTURES:
        raise RcdnError(f"{len(shots)} pictures show a board to both; the comparison takes {FEWEST_PICTURES}")
    gaps: dict[str, list[Array]] = {"rcdn": [], "opencv": []}
    failed = 0
    for seed in range(seeds):
        order = np.random.default_rng(seed).permutation(len(shots))
        first, second = order[: len(order) // 2], order[len(order) // 2 :]
        for some, others in ((first, second), (second, first)):
            mine, theirs = [shots[k] for k in some], [shots[k] for k in others]
            try:
                known = {"rcdn": ours(mine, spacing), "opencv": opencvs(mine, spacing)}
            except (CalibrationError, cv2.error):
                failed += 1
                continue
            for name, camera in known.items():
                gaps[name] += [held_out(shot, camera, spacing, name == "rcdn") for shot in theirs]
    rms = {name: _rms(each) for name, each in gaps.items()}
    return {"pictures": len(shots), "halves": 2 * seeds, "failed": failed, **rms, "ratio": rms["rcdn"] / rms["opencv"]}


def ours(shots: Sequence[Shot], spacing: float) -> Known:
    """Our calibration from our corners, given only the spacing."""
    found = calibrate([s.board for s in shots], spacing, names=[s.name for s in shots])
    return Known(found.camera, found.shape)


def opencvs(shots: Sequence[Shot], spacing: float) -> Known:
    """OpenCV's calibration from its corners."""
    size = shots[0].board.image_size
    corners = [np.column_stack([_labels(s, s.ids), np.zeros(len(s.ids))]) * spacing for s in shots]
    _, K, distortion, _, _ = cv2.calibrateCamera(
        [c.astype(np.float32) for c in corners], [s.xy.astype(np.float32) for s in shots], size, np.eye(3), np.zeros(5)
    )
    return Known(Camera(K, np.ravel(distortion), size))


def held_out(shot: Shot, known: Known, spacing: float, own: bool) -> Array:
    """(N, 2) residuals, px, of the corners that both found, each under the pose from the other half of a checkerboard
    split of them; `own`: of our corners."""
    ids, xy = (present(shot.board.ids, "ids"), shot.board.xy) if own else (shot.ids, shot.xy)
    common = shot.common
    order = np.argsort(ids)
    xy = xy[order[np.searchsorted(ids, common, sorter=order)]]
    ij = _labels(shot, common)
    board, basis = on_shape(ij * spacing, ij, known.shape)
    zero = np.zeros(len(ij), int)
    corners = Corners3(zero, zero, board, xy, basis)
    out = np.full(xy.shape, np.nan)
    for half in (ij.sum(axis=1) % 2 == 0, ij.sum(axis=1) % 2 == 1):
        state = State.mono(known.camera, poses(known.camera, [Seen(board[half], xy[half])]), KNOWN)
        some = corners.take(half)
        state = solve(state, some, np.ones(len(some)), default_free(state, lens=False)).state
        out[~half] = residuals(state, corners)[~half]
    return out


def _labels(shot: Shot, ids: Array) -> Array:
    """(N, 2) labels on the target of the corners with these ids."""
    return np.asarray(shot.board.target.ij_of(ids)) if shot.board.target is not None else np.zeros((0, 2), int)


def _rms(gaps: Sequence[Array]) -> float:
    """Root mean squared length; infinite if a corner has no projection."""
    square = np.concatenate(gaps or [np.full((1, 2), np.nan)])
    return float(np.sqrt(np.nan_to_num((square**2).sum(axis=1), nan=np.inf).mean()))

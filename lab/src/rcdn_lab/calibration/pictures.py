"""Results of all detectors for the pictures of one camera, and the whole boards among them with corners in the same
order."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rcdn.types import Array
from rcdn_lab.calibration.detectors import Answer, Contestant
from rcdn_lab.calibration.sets import CameraSet
from rcdn_lab.peers import Grid

APART = 0.3
"""squares: a board whose median distance from the median over all detectors is larger does not consist of the same
corners"""


@dataclass(frozen=True, eq=False)
class Found:
    """`names` of the V pictures of `image_size` (width, height); `grids`: by detector and picture; `notes`: further
    remarks, by detector ("" for the set)."""

    names: list[str]
    image_size: tuple[int, int]
    grids: dict[str, list[tuple[Grid, ...]]]
    notes: dict[str, str]

    def of(self, names: Sequence[str]) -> Found:
        """The same for some detectors only."""
        return replace(self, grids={n: self.grids[n] for n in names})


def detect(
    cameras: CameraSet, data: Path, detectors: Sequence[Contestant], step: Callable[[], None] | None = None
) -> Found:
    """Run all detectors on all pictures of a set; pictures of an unusual size are left out for all of them. `step` is
    called after each picture.

    Raises ConfigError if there are no pictures, ImageError if one cannot be read.
    """
    files = cameras.files(data)
    answers: list[dict[str, Answer]] = []
    for path in files:
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        answers.append({d.name: d.result(path, content, cameras.size) for d in detectors})
        if step:
            step()
    sizes = Counter(next(iter(a.values())).image_size for a in answers)
    majority = sizes.most_common(1)[0][0]
    kept = [k for k, a in enumerate(answers) if next(iter(a.values())).image_size == majority]
    grids = {d.name: [answers[k][d.name].grids for k in kept] for d in detectors}
    notes = {d.name: _failures([answers[k][d.name] for k in kept]) for d in detectors}
    odd = len(files) - len(kept)
    notes[""] = f"{odd} pictures of another size left out" if odd else ""
    return Found([files[k].name for k in kept], majority, grids, notes)


def _failures(answers: Sequence[Answer]) -> str:
    failed = [a.error for a in answers if a.error]
    return f"broke down on {len(failed)} pictures ({failed[0]})" if failed else ""


def whole(grids: Sequence[Grid], size: tuple[int, int]) -> Array | None:
    """The first whole board of `size` (columns, rows) among `grids`: (rows, columns, 2) px, columns × rows with the
    handedness of x × y; None if there is none.

    A board with transposed size is rotated, one with mirrored labels is reflected.
    """
    for grid in grids:
        if grid.ij is None or len(grid.ij) != size[0] * size[1] or len(np.unique(grid.ij, axis=0)) != len(grid.ij):
            continue
        ij = grid.ij - grid.ij.min(axis=0)
        cols, rows = (int(v) for v in ij.max(axis=0) + 1)
        if sorted((cols, rows)) != sorted(size):
            continue
        out = np.empty((rows, cols, 2))
        out[ij[:, 1], ij[:, 0]] = grid.xy
        return _upright(out, size)
    return None


def _upright(grid: Array, size: tuple[int, int]) -> Array:
    if handedness(grid) < 0:
        grid = grid[:, ::-1]
    return grid if grid.shape[:2] == size[::-1] else np.rot90(grid)


def handedness(grid: Array) -> float:
    """Positive if columns × rows of `grid` (rows, columns, 2) have the handedness of x × y: the sum over its cells
    without NaN."""
    across, down = np.diff(grid, axis=1)[:-1], np.diff(grid, axis=0)[:, :-1]
    return float(np.nansum(across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]))


def like(grid: Array, other: Array) -> Array:
    """`grid` (rows, columns, 2) in the rotation closest to `other`, so that the same corner gets the same label."""
    turns = [np.rot90(grid, k) for k in range(4)]
    same = [t for t in turns if t.shape == other.shape]
    return min(same, key=lambda t: float(np.linalg.norm(t - other, axis=2).mean()))


@dataclass(frozen=True, eq=False)
class Common:
    """The C pictures `index` in which all detectors found the whole board with the same corners; `xy`: by detector (C,
    M, 2) px, row by row; `sigma`: for detectors that return it (C, M); `ij` (M, 2); `disputed`: number of pictures in
    which they disagree about the corners."""

    index: list[int]
    xy: dict[str, Array]
    sigma: dict[str, Array]
    ij: Array
    disputed: int


def common(found: Found, size: tuple[int, int]) -> Common:
    """The corresponding corners of all detectors of `found`."""
    names = list(found.grids)
    index, disputed, boards, spreads = [], 0, [], []
    for k in range(len(found.names)):
        grids = {n: whole(found.grids[n][k], size) for n in names}
        if any(g is None for g in grids.values()):
            continue
        first = grids[names[0]]
        turned = np.stack([like(grids[n], first) for n in names])  # type: ignore[arg-type]
        if _same_corners(turned):
            index.append(k)
            boards.append(turned.reshape(len(names), -1, 2))
            spreads.append([_sigma(found.grids[n][k], t) for n, t in zip(names, turned, strict=True)])
        else:
            disputed += 1
    ij = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2)
    xy = {n: np.array([b[i] for b in boards]).reshape(-1, len(ij), 2) for i, n in enumerate(names)}
    by_name = {n: [s[i] for s in spreads] for i, n in enumerate(names)}
    sigma = {n: np.array(s) for n, s in by_name.items() if s and all(v is not None for v in s)}
    return Common(index, xy, sigma, ij, disputed)


def _same_corners(boards: Array) -> bool:
    """Whether `boards` (D, rows, columns, 2) consist of the same corners."""
    middle = np.median(boards, axis=0)
    step = min(float(np.median(np.linalg.norm(np.diff(middle, axis=a), axis=2))) for a in (0, 1))
    far = np.median(np.linalg.norm(boards - middle, axis=3), axis=(1, 2))
    return bool((far < APART * step).all())


def _sigma(grids: Sequence[Grid], turned: Array) -> Array | None:
    """The standard deviations (M,) of a whole board's corners in the order of `turned` (rows, columns, 2), matched by
    their positions."""
    for grid in grids:
        if grid.sigma is not None and len(grid.xy) == turned.shape[0] * turned.shape[1]:
            known = {spot: s for spot, s in zip(map(tuple, grid.xy.tolist()), grid.sigma.tolist(), strict=True)}
            spots = [tuple(s) for s in turned.reshape(-1, 2).tolist()]
            if all(s in known for s in spots):
                return np.array([known[s] for s in spots])
    return None

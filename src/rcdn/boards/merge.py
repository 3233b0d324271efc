"""Merges parts of one board that a shadow, a finger or glare has separated."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop

import numpy as np

from rcdn.boards.graph import Field
from rcdn.boards.grow import board_sign
from rcdn.boards.local import WIDEST, Grid, predictions, windows
from rcdn.geometry.boxes import BoxCells
from rcdn.geometry.division import Division, division_of
from rcdn.geometry.homography import homography, in_front
from rcdn.geometry.matrices import inverse, product
from rcdn.geometry.near import nearest
from rcdn.geometry.rules import CHECKER, Label
from rcdn.types import Array
from rcdn.types.arrays import Bool, Int, Real

GAP = 3
"""largest gap between two parts, squares"""
OFF = 0.08
"""largest distance from a lattice point of the other part, squares, for each square of the gap"""
STRETCH = 0.25
"""largest difference of the two lattices' steps where they face each other, squares"""
LEAST_VOTES, SHARE = 3, 0.8
"""corners that must agree on how two parts lie, and share of those within `GAP` of the other part"""
FLAT, FLAT_LINES, LEAST_GUEST = 12, 3, 9
"""fewest corners, and lines of them along both axes, from which perspective is estimated; and fewest of another part
for which that is worth its time"""
CURVED = 0.03
"""squares: RMS distance from the plane above which the lens's distortion is estimated, too"""
SAME = 0.4
"""squares: what is nearer to a corner along both axes lies among the lattice's corners"""
HORIZON = 0.1
"""least ratio of the smallest to the largest depth of a lattice with which its homography is used"""
Motion = tuple[int, int, int]
"""number of quarter turns, shift in u, shift in v"""


def merge(field: Field, grids: list[Grid]) -> list[Grid]:
    """Join grids that share one lattice, larger ones first; all others are left unchanged.

    A part joins if at least three of its corners, and four fifths of those near enough to vote, lie on extrapolated
    lattice points of the other under one rotation and shift, and vice versa; if their steps agree where they face each
    other; if the colours agree; and if no label is occupied.
    """
    if len(grids) < 2:
        return grids
    parts = [_Lattice(grid) for grid in sorted(grids, key=lambda g: (-len(g), min(g.at.values())))]
    boxes = BoxCells(np.array([p.low - p.reach for p in parts]), np.array([p.high + p.reach for p in parts]))
    free, out = np.ones(len(parts), bool), []
    for k, host in enumerate(parts):
        if not free[k]:
            continue
        free[k], again = False, _near(parts, boxes, free, host)
        while again:
            n = heappop(again)
            if not free[n] or not _join(field, host, parts[n]):
                continue
            free[n] = False
            # of the parts that did not join before, only those near the new part can join now
            again = sorted({*again, *_near(parts, boxes, free, parts[n])})
        out.append(host.grid)
    return out


def _near(parts: list[_Lattice], boxes: BoxCells, free: Array, host: _Lattice) -> list[int]:
    """Indices, ascending, of the `free` parts that are not certainly too far from `host`."""
    around = boxes.touched(host.low - host.reach, host.high + host.reach)
    return [n for n in around if free[n] and not parts[n].apart(host)]


class _Lattice:
    """A grid as an operand of merging: `labels` (M, 2), positions `xy` (M, 2), and the steps there, `steps` (M, 2, 2),
    columns du, dv, NaN if unknown. `low`, `high` (2,): bounding box of the positions; `reach`: distance from it beyond
    which nothing is within `GAP` of its squares.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid, self.labels, self.corners = grid, grid.labels, grid.corners
        self.xy = grid.xy[self.corners]
        self.steps = _steps(self.labels, self.xy, self.labels)
        self.low, self.high = self.xy.min(axis=0), self.xy.max(axis=0)
        self.reach = _reach(self.steps)
        self._sign, self._own = 0, False
        self._frames: list[_Frame | None] = [None, None]
        self._lens_known = False

    def sign(self, field: Field) -> int:
        """The board's colouring; a part that joins must agree with it and does not change it."""
        self._sign = self._sign or board_sign(field, self.grid)
        return self._sign

    def apart(self, other: _Lattice) -> bool:
        """Whether two grids are certainly further apart than `GAP` squares of either."""
        gap = max((self.low - other.high).max(), (other.low - self.high).max())
        return bool(gap > max(self.reach, other.reach))

    def within(self, other: _Lattice) -> Array:
        """Rows of the corners that are not certainly further than that from the other's box."""
        reach = max(self.reach, other.reach)
        return np.flatnonzero(((self.xy >= other.low - reach) & (self.xy <= other.high + reach)).all(axis=1))

    def plane(self) -> _Frame | None:
        """Its frame without perspective; None with too few corners."""
        if self._frames[0] is None and len(self.labels) >= FLAT and np.ptp(self.labels, axis=0).min() >= FLAT_LINES - 1:
            self._frames[0] = _Frame.of(self)
        return self._frames[0]

    def plane_of_lens(self, shape: tuple[int, ...]) -> _Frame | None:
        """The same without the distortion of the lens, too, of an image of `shape` (H, W); None where none is seen."""
        if not self._lens_known:
            plane, self._lens_known = self.plane(), True
            gap = 0.0 if plane is None else plane.of_pixels(self.xy)[0] - self.labels
            lens = None
            if np.sqrt(2 * np.square(gap).mean()) > CURVED:
                lens = division_of(self.labels.astype(float), self.xy, (shape[1], shape[0]))
            self._frames[1] = None if lens is None else _Frame.of(self, lens)
        return self._frames[1]

    def seen_from(self, rows: Array, at: Real[Array, "k 2"], frame: _Frame | None) -> tuple[Array, Array, Array]:
        """For positions `at` (K, 2) px: the nearest corners among `rows`, (K,) rows; the offsets from them (K, 2),
        squares; and the inverses (K, 2, 2) of the lattice's steps there, squares per px. `frame`: that in which it is
        continued; None: the picture."""
        if frame is None:
            near = rows[nearest(self.xy[rows], at)[1][:, 0]]
            squares = _inverses(self.steps[near])
            return near, product(squares, (at - self.xy[near])[..., None])[..., 0], squares
        (level, _), (spots, slopes) = frame.of_pixels(self.xy), frame.of_pixels(at)
        near = rows[nearest(level[rows], spots)[1][:, 0]]
        some, where = np.unique(near, return_inverse=True)
        around = _close(self.labels, self.labels[some], WIDEST)
        squares = _inverses(_steps(self.labels[around], level[around], self.labels[some]))[where]
        offset = product(squares, (spots - level[near])[..., None])[..., 0]
        return near, offset, product(squares, slopes)

    def take(self, guest: _Lattice, motion: Motion) -> None:
        """Add a guest's corners, with their labels transformed by `motion`."""
        if not self._own:
            self.grid, self._own = Grid(self.grid.at, self.grid.xy), True
        labels = np.array([_move(motion, (u, v)) for u, v in guest.labels.tolist()], np.int64)
        self.grid.at |= zip(map(tuple, labels.tolist()), guest.corners.tolist(), strict=True)
        # a prediction uses only labels close by: all other steps remain valid
        changed = _close(self.labels, labels, WIDEST)
        joined = np.concatenate([self.labels, labels])
        xy = np.concatenate([self.xy, guest.xy])
        anew = np.concatenate([changed, np.arange(len(self.labels), len(joined))])
        near = _close(joined, joined[anew], WIDEST)
        self.steps = np.concatenate([self.steps, guest.steps])
        self.steps[anew] = _steps(joined[near], xy[near], joined[anew])
        self.labels, self.xy, self.corners = joined, xy, np.concatenate([self.corners, guest.corners])
        self.low, self.high = np.minimum(self.low, guest.low), np.maximum(self.high, guest.high)
        self.reach = max(self.reach, _reach(self.steps[anew]))
        self._frames, self._lens_known = [None, None], False


@dataclass(frozen=True, eq=False)
class _Frame:
    """Squares of a flat lattice: the homography `flat` (3, 3) of pixels without the distortion of the `lens`."""

    flat: Array
    lens: Division | None

    @classmethod
    def of(cls, lattice: _Lattice, lens: Division | None = None) -> _Frame | None:
        """The frame of a lattice; None if its corners are on one line."""
        labels = lattice.labels.astype(float)
        try:
            return cls(inverse(homography(labels, lattice.xy if lens is None else lens.undistorted(lattice.xy))), lens)
        except np.linalg.LinAlgError:
            return None

    def shows(self, xy: Real[Array, "n 2"]) -> bool:
        """Whether all pixels `xy` (N, 2) are in front of its horizon and within what the lens shows."""
        if self.lens is not None and not self.lens.sees(xy).all():
            return False
        return in_front(self.flat, xy if self.lens is None else self.lens.undistorted(xy), HORIZON)

    def of_pixels(self, xy: Real[Array, "n 2"]) -> tuple[Array, Array]:
        """Squares (N, 2) of pixels `xy` (N, 2), and their Jacobians (N, 2, 2); by sums in a fixed order."""
        plain = xy if self.lens is None else self.lens.undistorted(xy)
        x, y = plain.T
        u, v, depth = (row[0] * x + row[1] * y + row[2] for row in self.flat)
        to = np.stack([u / depth, v / depth], axis=1)
        slopes = (self.flat[:2, :2] - to[:, :, None] * self.flat[2, :2]) / depth[:, None, None]
        return to, slopes if self.lens is None else product(slopes, self.lens.slopes(xy))


def _frames(
    host: _Lattice, here: Array, guest: _Lattice, there: Array, shape: tuple[int, ...]
) -> Iterator[_Frame | None]:
    """The frames in which two parts may be seen to be of one lattice, by the host's corners: None for pixels, if either
    has too few or its horizon is near; its plane; and its plane without the distortion of the lens, if that is seen.
    None at all where the guest lies among the host's corners. `shape`: (H, W) of the image."""
    every = np.concatenate([host.xy, guest.xy])
    plane = host.plane() if len(guest.labels) >= LEAST_GUEST else None
    if plane is None or not plane.shows(every):
        yield None
        return
    offset = host.seen_from(here, guest.xy[there], None)[1]
    if (np.abs(offset).max(axis=1) < SAME).mean() > 1 - SHARE:
        return
    yield plane
    through_lens = host.plane_of_lens(shape)
    if through_lens is not None and through_lens.shows(every):
        yield through_lens


def _reach(steps: Array) -> float:
    return 2 * (GAP + 1) * float(np.abs(np.nan_to_num(steps)).max(axis=(0, 2)).sum())


def _steps(labels: Int[Array, "m 2"], xy: Real[Array, "m 2"], spots: Int[Array, "k 2"]) -> Real[Array, "k 2 2"]:
    """Steps (K, 2, 2) at labels `spots` (K, 2), predicted from corners with `labels`, `xy` (M, 2)."""
    return predictions(labels, xy, spots).maps[:, 2:].reshape(-1, 2, 2).swapaxes(1, 2)


def _close(labels: Int[Array, "m 2"], others: Real[Array, "k 2"], reach: int) -> Array:
    """Rows of `labels` (M, 2) within `reach` squares of one of `others` (K, 2)."""
    low, high = others.min(axis=0) - reach, others.max(axis=0) + reach
    rows = np.flatnonzero(((labels >= low) & (labels <= high)).all(axis=1))
    known = windows(others, labels[rows], reach)
    return rows[(known >= 0).any(axis=1)]


def _join(field: Field, host: _Lattice, guest: _Lattice) -> bool:
    """Join a guest to its host, in place, if they share one lattice."""
    here, there = host.within(guest), guest.within(host)
    if not len(here) or not len(there):
        return False
    for frame in _frames(host, here, guest, there, field.grey.shape):
        motion = _motion(host, here, guest, there, frame)
        back = None if motion is None else _motion(guest, there, host, here, frame)
        if motion is not None and back is not None and _inverse(motion, back):
            break
    else:
        return False
    if any(_move(motion, spot) in host.grid.at for spot in guest.grid.at):
        return False
    if guest.sign(field) != (-1) ** sum(motion) * host.sign(field):
        return False
    host.take(guest, motion)
    return True


def _motion(host: _Lattice, here: Array, guest: _Lattice, there: Array, frame: _Frame | None) -> Motion | None:
    """The rotation and shift that take the guest's labels to the host's, or None if there is no clear majority. Only
    the rows `here` of the host and `there` of the guest are used. `frame`: as of `_Lattice.seen_from`."""
    near, offset, squares = host.seen_from(here, guest.xy[there], frame)
    whole = np.rint(offset)
    reach = np.abs(whole).max(axis=1)
    voters = (reach >= 1) & (reach <= GAP)
    close = np.flatnonzero(voters & (np.abs(offset - whole).max(axis=1) <= OFF * reach))
    if len(close) < max(LEAST_VOTES, SHARE * int(voters.sum())):
        return None  # each corner has at most one vote per motion
    alike = _same_steps(squares[close], guest.steps[there[close]])
    votes: Counter[Motion] = Counter()
    base = host.labels[near[close]] + whole[close].astype(int)
    for spot, (u, v), turns in zip(guest.labels[there[close]].tolist(), base.tolist(), alike, strict=True):
        for turn in np.flatnonzero(turns).tolist():
            d, e = _move((turn, 0, 0), (spot[0], spot[1]))
            votes[turn, u - d, v - e] += 1
    if not votes:
        return None
    motion, count = min(votes.items(), key=lambda item: (-item[1], item[0]))
    return motion if count >= max(LEAST_VOTES, SHARE * int(voters.sum())) else None


def _inverse(motion: Motion, back: Motion) -> bool:
    return all(_move(back, _move(motion, spot)) == spot for spot in ((0, 0), (1, 0), (0, 1)))


def _move(motion: Motion, spot: Label) -> Label:
    u, v = CHECKER.turn(*spot, motion[0])
    return u + motion[1], v + motion[2]


def _inverses(steps: Array) -> Real[Array, "m 2 2"]:
    """Inverses (M, 2, 2) of steps, NaN where the steps are singular."""
    (a, b), (c, d) = steps.transpose(1, 2, 0)
    area = a * d - b * c
    area = np.where(np.abs(area) >= 1e-6, area, np.nan)
    return np.asarray((np.array([[d, -b], [-c, a]]) / area).transpose(2, 0, 1))


def _same_steps(squares: Real[Array, "k 2 2"], steps: Real[Array, "k 2 2"]) -> Bool[Array, "k 4"]:
    """(K, 4) bool: whether a guest's `steps` (K, 2, 2), after 0 to 3 quarter turns, agree with the host's to a quarter
    of a square.

    `squares` (K, 2, 2): inverses of the host's steps.
    """
    out = []
    for turns in range(4):  # where labels turn, the steps along the axes turn back
        back = np.array([CHECKER.steps[-turns], CHECKER.steps[1 - turns]]).T
        difference = product(squares, product(steps, back)) - np.eye(2)
        out.append(np.linalg.norm(difference, axis=1).max(axis=1, initial=0) < STRETCH)
    return np.stack(out, axis=1)
